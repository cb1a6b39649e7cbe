//! Residuals over iterations as a picture.

use std::fmt::Write as _;

use super::Run;

const WIDTH: f64 = 760.0;
const HEIGHT: f64 = 440.0;
/// Left, right, top and bottom of the frame.
const FRAME: [f64; 4] = [70.0, 590.0, 46.0, 392.0];
/// Colors that are told apart also by those who see fewer of them (Okabe and Ito 2008).
const COLORS: [&str; 7] =
    ["#000000", "#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9"];
/// Below this is zero. \[1\]
const LEAST: f64 = 1e-17;

/// One line per run, both axes logarithmic: the best residual so far, whatever the method tried.
pub(super) fn svg(name: &str, runs: &[Run], tolerance: f64) -> String {
    let last = |run: &Run| run.solved.outcome.history.iter().map(|s| s.iteration).max();
    let longest = runs.iter().filter_map(last).max().unwrap_or(0).max(9);
    let residuals = runs.iter().flat_map(|run| &run.solved.outcome.history).map(|s| s.residual);
    let (low, high) = residuals
        .filter(|residual| residual.is_finite())
        .map(|residual| residual.max(LEAST).log10())
        .fold((tolerance.log10(), 0.0f64), |(low, high), x| (low.min(x), high.max(x)));
    let axes =
        Axes { decades: ((longest + 1) as f64).log10(), low: low.floor(), high: high.ceil() };
    let mut svg = String::new();
    // Writing to a string does not fail.
    let _ = write!(
        svg,
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDTH} {HEIGHT}\" \
         font-family=\"sans-serif\" font-size=\"12\">\n\
         <rect width=\"{WIDTH}\" height=\"{HEIGHT}\" fill=\"#ffffff\"/>\n\
         <text x=\"{}\" y=\"26\" font-size=\"15\">{}</text>\n",
        FRAME[0],
        escaped(name)
    );
    axes.draw(&mut svg, tolerance);
    for (i, run) in runs.iter().enumerate() {
        curve(&mut svg, &axes, run, COLORS[i % COLORS.len()], i);
    }
    svg.push_str("</svg>\n");
    svg
}

struct Axes {
    /// Decades of iterations, counted from 1.
    decades: f64,
    low: f64,
    high: f64,
}

impl Axes {
    fn x(&self, iteration: usize) -> f64 {
        let [left, right, ..] = FRAME;
        left + (right - left) * ((iteration + 1) as f64).log10() / self.decades
    }

    fn y(&self, residual: f64) -> f64 {
        let [.., top, bottom] = FRAME;
        let part = (residual.max(LEAST).log10() - self.low) / (self.high - self.low).max(1.0);
        bottom - (bottom - top) * part.clamp(0.0, 1.0)
    }

    fn draw(&self, svg: &mut String, tolerance: f64) {
        let [left, right, top, bottom] = FRAME;
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
        let longest = 10f64.powf(self.decades) as usize;
        let columns: Vec<usize> = [0]
            .into_iter()
            .chain((1..).map(|p| 10usize.pow(p)).take_while(|&n| n < longest))
            .collect();
        for &count in &columns {
            let x = self.x(count);
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
        for count in columns {
            let (x, y) = (self.x(count), bottom + 18.0);
            let _ =
                writeln!(svg, "<text x=\"{x:.1}\" y=\"{y}\" text-anchor=\"middle\">{count}</text>");
        }
        let _ = writeln!(
            svg,
            "<rect x=\"{left}\" y=\"{top}\" width=\"{}\" height=\"{}\" fill=\"none\" \
             stroke=\"#444444\"/>\n<text x=\"{}\" y=\"{}\" text-anchor=\"middle\">iterations</text>\n\
             <text x=\"16\" y=\"{}\" text-anchor=\"middle\" transform=\"rotate(-90 16 {})\">\
             relative residual</text>",
            right - left,
            bottom - top,
            0.5 * (left + right),
            bottom + 38.0,
            0.5 * (top + bottom),
            0.5 * (top + bottom),
        );
    }
}

fn curve(svg: &mut String, axes: &Axes, run: &Run, color: &str, place: usize) {
    let outcome = &run.solved.outcome;
    let mut best = f64::INFINITY;
    let mut points = String::new();
    let mut end = None;
    for sample in &outcome.history {
        // Only what is better moves the line; the last sample ends it.
        let last = Some(sample) == outcome.history.last();
        if sample.residual < best || last {
            best = best.min(sample.residual);
            if best.is_finite() {
                let (x, y) = (axes.x(sample.iteration), axes.y(best));
                let _ = write!(points, "{x:.1},{y:.1} ");
                end = Some((x, y));
            }
        }
    }
    let y = FRAME[2] + 12.0 + 40.0 * place as f64;
    let x = FRAME[1] + 14.0;
    let (name, status) = (run.choice.name(), outcome.status.name());
    let _ = writeln!(
        svg,
        "<polyline points=\"{}\" fill=\"none\" stroke=\"{color}\" stroke-width=\"1.8\"/>\n\
         <line x1=\"{x}\" y1=\"{y}\" x2=\"{}\" y2=\"{y}\" stroke=\"{color}\" stroke-width=\"2.5\"/>\n\
         <text x=\"{}\" y=\"{}\">{name}</text>\n\
         <text x=\"{}\" y=\"{}\" fill=\"#666666\">{status}, {:.1} ms</text>",
        points.trim_end(),
        x + 18.0,
        x + 24.0,
        y + 4.0,
        x + 24.0,
        y + 19.0,
        run.milliseconds(),
    );
    if let Some((x, y)) = end {
        let _ = writeln!(svg, "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"3\" fill=\"{color}\"/>");
    }
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
}
