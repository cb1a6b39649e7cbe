//! Picture of overlap against time for engines at several settings.

use std::fmt::Write as _;

use crate::engines::EngineKind;
use crate::table::{Table, number};

const WIDTH: f64 = 720.0;
/// Height of the frame of a scene, and the edges of the plot within it.
const PART: f64 = 400.0;
const LEFT: f64 = 70.0;
const RIGHT: f64 = 560.0;
const TOP: f64 = 40.0;
const BOTTOM: f64 = 340.0;
/// Colors that remain distinct with color blindness (Okabe and Ito 2008), in the order of
/// [`EngineKind::ALL`].
const COLORS: [&str; 6] = ["#d55e00", "#0072b2", "#0072b2", "#009e73", "#009e73", "#cc79a7"];
/// Lower limit of plotted values, since the axes are logarithmic.
const LEAST: f64 = 1e-4;
/// Overlaps at which times are compared. \[mm\]
const BOUNDS: [f64; 7] = [10.0, 3.0, 1.0, 0.3, 0.1, 0.03, 0.01];

/// Time and overlap of all settings on a scene.
pub(crate) struct Frontier {
    scene: String,
    points: Vec<FrontierPoint>,
}

struct FrontierPoint {
    kind: EngineKind,
    setting: String,
    /// Time per step \[ms\] and overlap \[mm\].
    at: [f64; 2],
    /// True if a standing scene has fallen, so that its overlap says little.
    fallen: bool,
}

impl Frontier {
    pub(crate) fn new(scene: String) -> Self {
        Self { scene, points: Vec::new() }
    }

    /// Adds a setting of an engine with its time per step \[ms\] and its overlap \[mm\].
    pub(crate) fn add(&mut self, kind: EngineKind, setting: String, at: [f64; 2], fallen: bool) {
        self.points.push(FrontierPoint { kind, setting, at: at.map(|x| x.max(LEAST)), fallen });
    }

    /// Returns a ratio of times for each bound. It divides the time of Drystone's cheapest setting
    /// with an overlap below the bound by that of the cheapest setting of all other engines.
    fn ratios(&self) -> impl Iterator<Item = String> + '_ {
        BOUNDS.into_iter().map(|bound| {
            let cheapest = |own: bool| {
                let reach = |p: &&FrontierPoint| !p.fallen && p.at[1] <= bound;
                let points = self.points.iter().filter(|p| (p.kind == EngineKind::Drystone) == own);
                points.filter(reach).map(|p| p.at[0]).reduce(f64::min)
            };
            match [cheapest(true), cheapest(false)] {
                [Some(own), Some(other)] => format!("{:.2}", own / other),
                [Some(own), None] => format!("alone, {} ms", number(own)),
                [None, Some(_)] => "others".to_string(),
                [None, None] => "nobody".to_string(),
            }
        })
    }

    fn draw(&self, svg: &mut String, top: f64) {
        let axes = [0, 1].map(|axis| Axis::of(self.points.iter().map(|point| point.at[axis])));
        let place = |at: [f64; 2]| {
            [
                LEFT + (RIGHT - LEFT) * axes[0].part(at[0]),
                top + BOTTOM - (BOTTOM - TOP) * axes[1].part(at[1]),
            ]
        };
        // Writing to a string does not fail.
        let _ = writeln!(
            svg,
            "<text x=\"{LEFT}\" y=\"{}\" font-size=\"15\">{}</text>",
            top + TOP - 12.0,
            escaped(&self.scene)
        );
        for decade in axes[0].decades() {
            let [x, y] = place([decade, axes[1].low()]);
            let _ = writeln!(
                svg,
                "<line x1=\"{x:.1}\" y1=\"{:.1}\" x2=\"{x:.1}\" y2=\"{y:.1}\" stroke=\"#dddddd\"/>\n\
                 <text x=\"{x:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{decade}</text>",
                top + TOP,
                y + 18.0
            );
        }
        for decade in axes[1].decades() {
            let [x, y] = place([axes[0].low(), decade]);
            let _ = writeln!(
                svg,
                "<line x1=\"{x:.1}\" y1=\"{y:.1}\" x2=\"{RIGHT}\" y2=\"{y:.1}\" stroke=\"#dddddd\"/>\n\
                 <text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"end\">{decade}</text>",
                x - 8.0,
                y + 4.0
            );
        }
        let (across, down) = (0.5 * (LEFT + RIGHT), top + 0.5 * (TOP + BOTTOM));
        let _ = writeln!(
            svg,
            "<rect x=\"{LEFT}\" y=\"{}\" width=\"{}\" height=\"{}\" fill=\"none\" \
             stroke=\"#444444\"/>\n\
             <text x=\"{across}\" y=\"{}\" text-anchor=\"middle\">settled ms per step</text>\n\
             <text x=\"16\" y=\"{down}\" text-anchor=\"middle\" transform=\"rotate(-90 16 {down})\">\
             deepest overlap in mm</text>",
            top + TOP,
            RIGHT - LEFT,
            BOTTOM - TOP,
            top + BOTTOM + 36.0
        );
        let mut rows = 0;
        for (kind, color) in EngineKind::ALL.into_iter().zip(COLORS) {
            let points: Vec<&FrontierPoint> =
                self.points.iter().filter(|p| p.kind == kind).collect();
            if points.is_empty() {
                continue;
            }
            let mut line = String::new();
            for point in &points {
                let [x, y] = place(point.at);
                let _ = write!(line, "{x:.1},{y:.1} ");
                let inside = if point.fallen { "#ffffff" } else { color };
                let _ = writeln!(
                    svg,
                    "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"4\" fill=\"{inside}\" \
                     stroke=\"{color}\"/>\n\
                     <text x=\"{:.1}\" y=\"{:.1}\" font-size=\"10\" fill=\"{color}\">{}</text>",
                    x + 6.0,
                    y - 5.0,
                    escaped(&point.setting)
                );
            }
            let y = top + TOP + 12.0 + 20.0 * f64::from(rows);
            let _ = writeln!(
                svg,
                "<polyline points=\"{}\" fill=\"none\" stroke=\"{color}\"/>\n\
                 <line x1=\"{}\" y1=\"{y}\" x2=\"{}\" y2=\"{y}\" stroke=\"{color}\" \
                 stroke-width=\"2.5\"/>\n<text x=\"{}\" y=\"{}\">{}</text>",
                line.trim_end(),
                RIGHT + 14.0,
                RIGHT + 32.0,
                RIGHT + 38.0,
                y + 4.0,
                kind.name()
            );
            rows += 1;
        }
        if self.points.iter().any(|point| point.fallen) {
            let y = top + TOP + 16.0 + 20.0 * f64::from(rows);
            let _ = writeln!(svg, "<text x=\"{}\" y=\"{y}\">hollow: fallen</text>", RIGHT + 14.0);
        }
    }
}

/// Returns the table of time ratios, Drystone to the fastest other engine at the same overlap, for
/// each scene.
pub(crate) fn ratios(frontiers: &[Frontier]) -> Table {
    let bounds = BOUNDS.map(|bound| format!("{bound} mm"));
    let head: Vec<&str> =
        ["overlap below"].into_iter().chain(bounds.iter().map(String::as_str)).collect();
    let mut table = Table::new(&head);
    for frontier in frontiers {
        table.row([frontier.scene.clone()].into_iter().chain(frontier.ratios()).collect());
    }
    table
}

/// Range of whole decades that contains some values.
struct Axis {
    /// Powers of ten of both ends.
    ends: [i32; 2],
}

impl Axis {
    fn of(values: impl Iterator<Item = f64>) -> Self {
        let (low, high) = values
            .map(f64::log10)
            .fold((f64::MAX, f64::MIN), |(low, high), x| (low.min(x), high.max(x)));
        if low > high {
            return Self { ends: [0, 1] };
        }
        let low = low.floor() as i32;
        Self { ends: [low, (high.ceil() as i32).max(low + 1)] }
    }

    fn low(&self) -> f64 {
        10f64.powi(self.ends[0])
    }

    fn part(&self, value: f64) -> f64 {
        let [low, high] = self.ends.map(f64::from);
        (value.log10() - low) / (high - low)
    }

    fn decades(&self) -> impl Iterator<Item = f64> {
        (self.ends[0]..=self.ends[1]).map(|power| 10f64.powi(power))
    }
}

/// Draws one plot per scene with logarithmic axes. Points are hollow if a standing scene has
/// fallen.
pub(crate) fn svg(frontiers: &[Frontier]) -> String {
    let height = PART * frontiers.len() as f64;
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDTH} {height}\" \
         font-family=\"sans-serif\" font-size=\"12\">\n\
         <rect width=\"{WIDTH}\" height=\"{height}\" fill=\"#ffffff\"/>\n"
    );
    for (place, frontier) in frontiers.iter().enumerate() {
        frontier.draw(&mut svg, PART * place as f64);
    }
    svg.push_str("</svg>\n");
    svg
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
}
