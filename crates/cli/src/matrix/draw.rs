//! Picture with the matrix on the left and the contacts on the right.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use crate::solve::escaped;

/// Side of the matrix, and of the picture of the contacts.
const SIDE: f64 = 600.0;
const MARGIN: f64 = 30.0;
const TOP: f64 = 56.0;
/// Maximum size of a cell, and minimum size that has room for its label.
const CELL: [f64; 2] = [26.0, 9.0];
/// Width of a letter as a fraction of the font size.
const LETTER: f64 = 0.6;

/// Horizontal and vertical coordinate. \[m\]
pub(super) type Point = [f64; 2];

/// A nonzero block of A.
pub(super) struct Entry {
    pub(super) row: usize,
    pub(super) column: usize,
    /// The one dynamic body that both contacts share; `None` if they share two.
    pub(super) body: Option<u32>,
}

/// Content of the picture.
pub(super) struct Picture {
    pub(super) title: String,
    pub(super) entries: Vec<Entry>,
    /// Bodies a and b of each contact, and its point.
    pub(super) contacts: Vec<([u32; 2], Point)>,
    /// Name of each body, and its position if it is dynamic.
    pub(super) bodies: Vec<(String, Option<Point>)>,
}

/// Draws the picture as SVG.
pub(super) fn svg(picture: &Picture) -> String {
    let count = picture.contacts.len().max(1) as f64;
    let cell = (SIDE / count).min(CELL[0]);
    let size = (0.6 * cell).clamp(6.0, 12.0);
    let rows: Vec<String> = (picture.contacts.iter().enumerate())
        .map(|(i, ([a, b], _))| format!("{} – {}  {}", picture.name(*a), picture.name(*b), i + 1))
        .collect();
    let longest = rows.iter().map(|row| row.chars().count()).max().unwrap_or(0) as f64;
    let labels = if cell >= CELL[1] { longest * LETTER * size } else { 30.0 };
    let left = MARGIN + labels;
    let right = left + count * cell + 2.0 * MARGIN;
    let (width, height) = (right + SIDE + MARGIN, TOP + SIDE + MARGIN);
    let mut svg = String::new();
    // Writing to a string does not fail.
    let _ = write!(
        svg,
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width:.1} {height:.1}\" \
         font-family=\"sans-serif\" font-size=\"{size:.1}\">\n\
         <rect width=\"{width:.1}\" height=\"{height:.1}\" fill=\"#ffffff\"/>\n\
         <text x=\"{MARGIN}\" y=\"26\" font-size=\"15\">{}</text>\n",
        escaped(&picture.title)
    );
    for Entry { row, column, body } in &picture.entries {
        let (x, y) = (left + *column as f64 * cell, TOP + *row as f64 * cell);
        let color = body.map_or_else(|| "#555555".to_owned(), color);
        let _ = writeln!(
            svg,
            "<rect x=\"{x:.2}\" y=\"{y:.2}\" width=\"{cell:.2}\" height=\"{cell:.2}\" fill=\"{color}\"/>"
        );
    }
    let side = count * cell;
    let _ = writeln!(
        svg,
        "<rect x=\"{left:.1}\" y=\"{TOP}\" width=\"{side:.1}\" height=\"{side:.1}\" fill=\"none\" \
         stroke=\"#444444\"/>"
    );
    // If labels have no room, only every n-th number is written.
    let every = (size / cell).ceil().max(1.0) as usize;
    for (i, row) in rows.iter().enumerate().filter(|(i, _)| i % every == 0) {
        let middle = (i as f64 + 0.5) * cell;
        let text = if cell >= CELL[1] { escaped(row) } else { (i + 1).to_string() };
        let _ = writeln!(
            svg,
            "<text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"end\">{text}</text>\n\
             <text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{}</text>",
            left - 5.0,
            TOP + middle + 0.35 * size,
            left + middle,
            TOP - 5.0,
            i + 1
        );
    }
    graph(&mut svg, picture, right);
    svg.push_str("</svg>\n");
    svg
}

/// Writes a text of this font size, centered at a point.
fn label(svg: &mut String, ([x, y], size): (Point, f64), weight: &str, text: &str) {
    let _ = writeln!(
        svg,
        "<text x=\"{x:.1}\" y=\"{:.1}\" font-size=\"{size:.1}\" font-weight=\"{weight}\" \
         text-anchor=\"middle\">{}</text>",
        y + 0.35 * size,
        escaped(text)
    );
}

/// Draws dynamic bodies as discs. Lines lead from the discs of each pair of bodies to the mean of
/// their contact points. Other bodies are not drawn.
fn graph(svg: &mut String, picture: &Picture, left: f64) {
    let mut pairs: BTreeMap<[u32; 2], Vec<usize>> = BTreeMap::new();
    for (i, (bodies, _)) in picture.contacts.iter().enumerate() {
        pairs.entry(*bodies).or_default().push(i);
    }
    let used: Vec<(u32, Point)> = (picture.bodies.iter().enumerate())
        .filter(|(body, _)| pairs.keys().any(|pair| pair.contains(&(*body as u32))))
        .filter_map(|(body, (_, place))| Some((body as u32, (*place)?)))
        .collect();
    let points = || used.iter().map(|of| of.1).chain(picture.contacts.iter().map(|of| of.1));
    let bound = |pick: fn(f64, f64) -> f64| -> Point {
        [0, 1].map(|i| points().map(|point| point[i]).reduce(pick).unwrap_or(0.0))
    };
    let (low, high) = (bound(f64::min), bound(f64::max));
    let scale = (SIDE - 2.0 * MARGIN) / (high[0] - low[0]).max(high[1] - low[1]).max(1e-9);
    let place = |[x, y]: Point| -> Point {
        [left + MARGIN + (x - low[0]) * scale, TOP + MARGIN + (high[1] - y) * scale]
    };
    let size = (260.0 / (pairs.len() as f64).sqrt().max(1.0)).clamp(5.0, 12.0);
    let mut texts = String::new();
    let mut write =
        |at: Point, weight: &str, text: &str| label(&mut texts, (at, size), weight, text);
    for ([a, b], contacts) in &pairs {
        let part = 1.0 / contacts.len() as f64;
        let points = contacts.iter().filter_map(|&i| picture.contacts.get(i));
        let mean = points.fold([0.0; 2], |sum: Point, (_, point)| {
            [sum[0] + part * point[0], sum[1] + part * point[1]]
        });
        let middle = place(mean);
        for body in [a, b] {
            if let Some((_, center)) = used.iter().find(|of| of.0 == *body) {
                let [x, y] = place(*center);
                let _ = writeln!(
                    svg,
                    "<line x1=\"{x:.1}\" y1=\"{y:.1}\" x2=\"{:.1}\" y2=\"{:.1}\" stroke=\"#999999\"/>",
                    middle[0], middle[1]
                );
            }
        }
        let _ = writeln!(
            svg,
            "<rect x=\"{:.1}\" y=\"{:.1}\" width=\"4\" height=\"4\" fill=\"#444444\"/>",
            middle[0] - 2.0,
            middle[1] - 2.0
        );
        write([middle[0], middle[1] + size], "normal", &numbers(contacts));
    }
    for (body, center) in &used {
        let [x, y] = place(*center);
        let fill = color(*body);
        let _ =
            writeln!(svg, "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"{size:.1}\" fill=\"{fill}\"/>");
        write([x, y], "bold", picture.name(*body).trim_matches('\''));
    }
    svg.push_str(&texts);
}

impl Picture {
    fn name(&self, body: u32) -> &str {
        self.bodies.get(body as usize).map_or("", |(name, _)| name)
    }
}

/// Formats the numbers of the contacts of two bodies, from 1; these are consecutive.
fn numbers(contacts: &[usize]) -> String {
    match contacts {
        [] => String::new(),
        [one] => (one + 1).to_string(),
        [first, .., last] => format!("{}–{}", first + 1, last + 1),
    }
}

/// Returns the color of a body. Hues are a golden angle apart, so bodies with adjacent numbers look
/// different however many there are.
fn color(body: u32) -> String {
    let (saturation, lightness) = (0.6, 0.65);
    let chroma = saturation * f64::min(lightness, 1.0 - lightness);
    // Converted to red, green and blue, since not every SVG reader supports hues.
    let [r, g, b] = [0.0, 8.0, 4.0].map(|phase| {
        let k = (phase + f64::from(body) * 137.508 / 30.0) % 12.0;
        (255.0 * (lightness - chroma * (k - 3.0).min(9.0 - k).clamp(-1.0, 1.0))) as u8
    });
    format!("#{r:02x}{g:02x}{b:02x}")
}
