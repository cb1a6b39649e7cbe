//! Picture of residuals over iterations and over time.

use std::fmt::Write as _;

use drystone_solver::assembled::Sample;

use super::run::MethodRun;

const WIDTH: f64 = 760.0;
const HEIGHT: f64 = 800.0;
/// Left and right edge of the plots.
const SIDES: [f64; 2] = [70.0, 590.0];
/// Top and bottom edge of each plot.
const FRAMES: [[f64; 2]; 2] = [[46.0, 366.0], [422.0, 742.0]];
/// Colors that remain distinct with color blindness (Okabe and Ito 2008).
const COLORS: [&str; 7] =
    ["#000000", "#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9"];
/// Lower limit of plotted residuals. \[1\]
const LEAST: f64 = 1e-17;

/// Horizontal axis of a plot.
struct Across {
    title: &'static str,
    of: fn(&Sample) -> f64,
    /// Scale of the axis, which shows log10(value / unit + 1) and thus begins at zero.
    unit: f64,
}

const ACROSS: [Across; 2] = [
    Across { title: "iterations", of: |sample| sample.iteration as f64, unit: 1.0 },
    Across { title: "time in ms", of: |sample| sample.elapsed.as_secs_f64() * 1e3, unit: 1e-3 },
];

/// Draws one line per run in each plot, with logarithmic axes. A line shows the best residual so
/// far, whichever method reached it.
pub(super) fn svg(name: &str, runs: &[MethodRun], tolerance: f64) -> String {
    let samples = || runs.iter().flat_map(|run| &run.solved.outcome.history);
    let (low, high) = samples()
        .map(|sample| sample.residual)
        .filter(|residual| residual.is_finite())
        .map(|residual| residual.max(LEAST).log10())
        .fold((tolerance.log10(), 0.0f64), |(low, high), x| (low.min(x), high.max(x)));
    let mut svg = String::new();
    // Writing to a string does not fail.
    let _ = write!(
        svg,
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDTH} {HEIGHT}\" \
         font-family=\"sans-serif\" font-size=\"12\">\n\
         <rect width=\"{WIDTH}\" height=\"{HEIGHT}\" fill=\"#ffffff\"/>\n\
         <text x=\"{}\" y=\"26\" font-size=\"15\">{}</text>\n",
        SIDES[0],
        escaped(name)
    );
    for (across, frame) in ACROSS.iter().zip(FRAMES) {
        let longest = samples().map(across.of).fold(9.0 * across.unit, f64::max);
        let decades = (longest / across.unit + 1.0).log10();
        let axes = Axes { across, frame, decades, low: low.floor(), high: high.ceil() };
        axes.draw(&mut svg, tolerance);
        for (run, color) in runs.iter().zip(COLORS.iter().cycle()) {
            curve(&mut svg, &axes, run, color);
        }
    }
    for (place, (run, color)) in runs.iter().zip(COLORS.iter().cycle()).enumerate() {
        legend(&mut svg, run, color, place);
    }
    svg.push_str("</svg>\n");
    svg
}

struct Axes<'a> {
    across: &'a Across,
    /// Top and bottom edge.
    frame: [f64; 2],
    /// Length of the horizontal axis: log10(value / unit + 1) of the largest value.
    decades: f64,
    low: f64,
    high: f64,
}

impl Axes<'_> {
    fn x(&self, value: f64) -> f64 {
        let [left, right] = SIDES;
        left + (right - left) * (value / self.across.unit + 1.0).log10() / self.decades
    }

    fn y(&self, residual: f64) -> f64 {
        let [top, bottom] = self.frame;
        let part = (residual.max(LEAST).log10() - self.low) / (self.high - self.low).max(1.0);
        bottom - (bottom - top) * part.clamp(0.0, 1.0)
    }

    fn draw(&self, svg: &mut String, tolerance: f64) {
        let ([left, right], [top, bottom]) = (SIDES, self.frame);
        let mut line = |x1: f64, y1: f64, x2: f64, y2: f64, style: &str| {
            let _ = writeln!(
                svg,
                "<line x1=\"{x1:.1}\" y1=\"{y1:.1}\" x2=\"{x2:.1}\" y2=\"{y2:.1}\" {style}/>"
            );
        };
        let grid = "stroke=\"#dddddd\"";
        let rows = |step: usize| (self.low as i32..=self.high as i32).step_by(step);
        let step = if self.high - self.low > 12.0 { 2 } else { 1 };
        for power in rows(step) {
            let y = self.y(10f64.powi(power));
            line(left, y, right, y, grid);
        }
        let marks: Vec<f64> = [0.0]
            .into_iter()
            .chain((1..).map(|p| 10f64.powi(p)).take_while(|mark| mark.log10() < self.decades))
            .map(|mark| mark * self.across.unit)
            .collect();
        for &mark in &marks {
            let x = self.x(mark);
            line(x, top, x, bottom, grid);
        }
        let y = self.y(tolerance);
        line(left, y, right, y, "stroke=\"#888888\" stroke-dasharray=\"5 4\"");
        for power in rows(step) {
            let y = self.y(10f64.powi(power)) + 4.0;
            let x = left - 8.0;
            let _ =
                writeln!(svg, "<text x=\"{x}\" y=\"{y:.1}\" text-anchor=\"end\">1e{power}</text>");
        }
        for mark in marks {
            let (x, y) = (self.x(mark), bottom + 18.0);
            let _ =
                writeln!(svg, "<text x=\"{x:.1}\" y=\"{y}\" text-anchor=\"middle\">{mark}</text>");
        }
        let _ = writeln!(
            svg,
            "<rect x=\"{left}\" y=\"{top}\" width=\"{}\" height=\"{}\" fill=\"none\" \
             stroke=\"#444444\"/>\n<text x=\"{}\" y=\"{}\" text-anchor=\"middle\">{}</text>\n\
             <text x=\"16\" y=\"{}\" text-anchor=\"middle\" transform=\"rotate(-90 16 {})\">\
             relative residual</text>",
            right - left,
            bottom - top,
            0.5 * (left + right),
            bottom + 38.0,
            self.across.title,
            0.5 * (top + bottom),
            0.5 * (top + bottom),
        );
    }
}

fn curve(svg: &mut String, axes: &Axes<'_>, run: &MethodRun, color: &str) {
    let history = &run.solved.outcome.history;
    let mut best = f64::INFINITY;
    let mut points = String::new();
    let mut end = None;
    for sample in history {
        // The line has points only where the residual improves, and at the last sample.
        let last = Some(sample) == history.last();
        if sample.residual < best || last {
            best = best.min(sample.residual);
            if best.is_finite() {
                let (x, y) = (axes.x((axes.across.of)(sample)), axes.y(best));
                let _ = write!(points, "{x:.1},{y:.1} ");
                end = Some((x, y));
            }
        }
    }
    let points = points.trim_end();
    let _ = writeln!(
        svg,
        "<polyline points=\"{points}\" fill=\"none\" stroke=\"{color}\" stroke-width=\"1.8\"/>"
    );
    if let Some((x, y)) = end {
        let _ = writeln!(svg, "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"3\" fill=\"{color}\"/>");
    }
}

fn legend(svg: &mut String, run: &MethodRun, color: &str, place: usize) {
    let y = FRAMES[0][0] + 12.0 + 40.0 * place as f64;
    let x = SIDES[1] + 14.0;
    let (name, status) = (run.choice.name(), run.solved.outcome.status.name());
    let _ = writeln!(
        svg,
        "<line x1=\"{x}\" y1=\"{y}\" x2=\"{}\" y2=\"{y}\" stroke=\"{color}\" stroke-width=\"2.5\"/>\n\
         <text x=\"{}\" y=\"{}\">{name}</text>\n\
         <text x=\"{}\" y=\"{}\" fill=\"#666666\">{status}, {:.1} ms</text>",
        x + 18.0,
        x + 24.0,
        y + 4.0,
        x + 24.0,
        y + 19.0,
        run.milliseconds(),
    );
}

/// Escapes text for XML.
pub(crate) fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
}
