//! Picture with the matrix on the left, and the contacts and joints on the right.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use crate::solve::{escaped, short};

/// Side of the matrix, and of the picture of the contacts and joints.
const SIDE: f64 = 600.0;
const MARGIN: f64 = 30.0;
const TOP: f64 = 56.0;
/// Maximum size of a cell without and with its number.
const CELL: [f64; 2] = [26.0, 60.0];
/// Minimum size of a cell that has room for its label.
const LABELED: f64 = 9.0;
/// Largest number of contacts and rows of joints whose entries, b and normals are shown.
const NUMBERED: usize = 16;
/// Number of digits of an entry.
const DIGITS: i32 = 3;
/// Length of a drawn normal.
const NORMAL: f64 = 18.0;
/// Width of a letter as a fraction of the font size.
const LETTER: f64 = 0.6;

/// Meaning of the colors.
const LEGEND: &str = "An entry has the color of the body that makes it, dark gray if two bodies \
                      do; red: normals, towards the first body of a row; dashed: joints.";
/// The world, as a body of a joint.
const WORLD: &str = "world";

/// Horizontal and vertical coordinate. \[m\]
pub(super) type Point = [f64; 2];

/// A nonzero block of A.
pub(super) struct Entry {
    pub(super) row: usize,
    pub(super) column: usize,
    /// a_ij, the velocity along normal or row i per unit of impulse along j. \[1/kg\]
    pub(super) value: f64,
    /// The one dynamic body that both share; `None` if they share two.
    pub(super) body: Option<u32>,
}

/// A contact or a row of a joint, which is a row and a column of A.
pub(super) struct Row {
    /// Bodies a and b; absent for the world.
    pub(super) bodies: [Option<u32>; 2],
    /// Index of the joint and name of its row; absent for a contact.
    pub(super) joint: Option<(u32, String)>,
    pub(super) point: Point,
    /// Normal of a contact from b to a, seen in the picture. \[1\]
    pub(super) normal: Option<Point>,
    /// b_i. \[m/s, rad/s\]
    pub(super) b: f64,
}

/// Content of the picture.
pub(super) struct Picture {
    pub(super) title: String,
    pub(super) entries: Vec<Entry>,
    pub(super) rows: Vec<Row>,
    /// Name of each body, and its position if it is dynamic.
    pub(super) bodies: Vec<(String, Option<Point>)>,
}

/// Sizes of the matrix in the picture.
struct Layout {
    cell: f64,
    /// Font size.
    size: f64,
    /// Left edge.
    left: f64,
    /// True if labels have room in each row.
    labeled: bool,
    /// True if entries have room for their numbers.
    numbered: bool,
}

impl Layout {
    fn new(count: usize, rows: &[String]) -> Self {
        let numbered = count <= NUMBERED;
        let cell = if numbered {
            (SIDE / (count + 1) as f64).min(CELL[1])
        } else {
            (SIDE / count as f64).min(CELL[0])
        };
        let (size, labeled) = ((0.6 * cell).clamp(6.0, 12.0), cell >= LABELED);
        let longest = rows.iter().map(|row| row.chars().count()).max().unwrap_or(0) as f64;
        let labels = if labeled { longest * LETTER * size } else { 30.0 };
        Self { cell, size, left: MARGIN + labels, labeled, numbered }
    }

    /// Returns the middle of row or column `i`, from the first.
    fn middle(&self, i: usize) -> f64 {
        (i as f64 + 0.5) * self.cell
    }
}

/// Draws the picture as SVG.
pub(super) fn svg(picture: &Picture) -> String {
    let count = picture.rows.len();
    let name = |body: Option<u32>| body.map_or(WORLD, |body| picture.name(body));
    let rows: Vec<String> = (picture.rows.iter().enumerate())
        .map(|(i, Row { bodies: [a, b], joint, .. })| match joint {
            Some((_, joint)) => format!("{joint}  {}", i + 1),
            None => format!("{} – {}  {}", name(*a), name(*b), i + 1),
        })
        .collect();
    let layout = Layout::new(count, &rows);
    let columns = if layout.numbered { count + 1 } else { count } as f64;
    let right = layout.left + columns * layout.cell + 2.0 * MARGIN;
    let mut drawn = String::new();
    matrix(&mut drawn, picture, &layout);
    labels(&mut drawn, &rows, &layout);
    if layout.numbered {
        numbers(&mut drawn, picture, &layout);
    }
    let bottom = graph(&mut drawn, picture, right).max(TOP + count as f64 * layout.cell);
    let (width, height) = (right + SIDE + MARGIN, bottom + 2.0 * MARGIN);
    format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width:.1} {height:.1}\" \
         font-family=\"sans-serif\" font-size=\"{:.1}\">\n\
         <rect width=\"{width:.1}\" height=\"{height:.1}\" fill=\"#ffffff\"/>\n\
         <text x=\"{MARGIN}\" y=\"26\" font-size=\"15\">{}</text>\n\
         <text x=\"{MARGIN}\" y=\"{:.1}\" font-size=\"11\">{LEGEND}</text>\n{drawn}</svg>\n",
        layout.size,
        escaped(&picture.title),
        height - 10.0,
    )
}

/// Draws a cell for each nonzero entry, and the outline.
fn matrix(svg: &mut String, picture: &Picture, layout: &Layout) {
    let Layout { cell, left, .. } = layout;
    for Entry { row, column, body, .. } in &picture.entries {
        let (x, y) = (left + *column as f64 * cell, TOP + *row as f64 * cell);
        let color = body.map_or_else(|| "#555555".to_owned(), color);
        let _ = writeln!(
            svg,
            "<rect x=\"{x:.2}\" y=\"{y:.2}\" width=\"{cell:.2}\" height=\"{cell:.2}\" \
             fill=\"{color}\"/>"
        );
    }
    let side = picture.rows.len() as f64 * cell;
    let _ = writeln!(
        svg,
        "<rect x=\"{left:.1}\" y=\"{TOP}\" width=\"{side:.1}\" height=\"{side:.1}\" fill=\"none\" \
         stroke=\"#444444\"/>"
    );
}

/// Writes the bodies or the name of each row, and the number of each column. If that has no room, only every
/// n-th number is written.
fn labels(svg: &mut String, rows: &[String], layout: &Layout) {
    let Layout { cell, size, left, labeled, .. } = layout;
    let every = (size / cell).ceil().max(1.0) as usize;
    for (i, row) in rows.iter().enumerate().filter(|(i, _)| i % every == 0) {
        let middle = layout.middle(i);
        let text = if *labeled { escaped(row) } else { (i + 1).to_string() };
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
}

/// Writes the entries of A, and the column b beside it.
fn numbers(svg: &mut String, picture: &Picture, layout: &Layout) {
    let size = 0.2 * layout.cell;
    let mut write = |row: Option<usize>, column: usize, fill: &str, text: &str| {
        let y = row.map_or(TOP - 5.0, |row| TOP + layout.middle(row) + 0.35 * size);
        let _ = writeln!(
            svg,
            "<text x=\"{:.1}\" y=\"{y:.1}\" font-size=\"{size:.1}\" fill=\"{fill}\" \
             text-anchor=\"middle\">{text}</text>",
            layout.left + layout.middle(column),
        );
    };
    for Entry { row, column, value, body } in &picture.entries {
        let fill = if body.is_some() { "#000000" } else { "#ffffff" };
        write(Some(*row), *column, fill, &short(*value, DIGITS));
    }
    let last = picture.rows.len();
    write(None, last, "#000000", "b [m/s]");
    for (row, of) in picture.rows.iter().enumerate() {
        write(Some(row), last, "#000000", &short(of.b, DIGITS));
    }
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

/// The rows of a joint of two bodies, or of their contacts.
type Link = (Option<u32>, [Option<u32>; 2]);

/// Draws dynamic bodies as discs. Lines lead from the discs of each pair of bodies to the mean of
/// their contact points, and to each of their joints. Other bodies are not drawn. Returns the lower
/// edge.
fn graph(svg: &mut String, picture: &Picture, left: f64) -> f64 {
    let mut links: BTreeMap<Link, Vec<usize>> = BTreeMap::new();
    for (i, row) in picture.rows.iter().enumerate() {
        let joint = row.joint.as_ref().map(|(joint, _)| *joint);
        links.entry((joint, row.bodies)).or_default().push(i);
    }
    let used: Vec<(u32, Point)> = (picture.bodies.iter().enumerate())
        .filter(|(body, _)| links.keys().any(|(_, pair)| pair.contains(&Some(*body as u32))))
        .filter_map(|(body, (_, place))| Some((body as u32, (*place)?)))
        .collect();
    let points = || used.iter().map(|of| of.1).chain(picture.rows.iter().map(|of| of.point));
    let bound = |pick: fn(f64, f64) -> f64| -> Point {
        [0, 1].map(|i| points().map(|point| point[i]).reduce(pick).unwrap_or(0.0))
    };
    let (low, high) = (bound(f64::min), bound(f64::max));
    let scale = (SIDE - 2.0 * MARGIN) / (high[0] - low[0]).max(high[1] - low[1]).max(1e-9);
    let place = |[x, y]: Point| -> Point {
        [left + MARGIN + (x - low[0]) * scale, TOP + MARGIN + (high[1] - y) * scale]
    };
    let size = (260.0 / (links.len() as f64).sqrt().max(1.0)).clamp(5.0, 12.0);
    let mut texts = String::new();
    let mut write =
        |at: Point, weight: &str, text: &str| label(&mut texts, (at, size), weight, text);
    for ((joint, pair), rows) in &links {
        let middle = place(picture.mean(rows));
        let ends = used.iter().filter(|(body, _)| pair.contains(&Some(*body)));
        let dashes = if joint.is_some() { " stroke-dasharray=\"4 3\"" } else { "" };
        link(svg, (middle, dashes), ends.map(|(_, center)| place(*center)));
        let first = rows.first().and_then(|&first| picture.rows[first].normal);
        if let Some(way) = first.filter(|_| picture.rows.len() <= NUMBERED) {
            normal(svg, middle, way);
        }
        write([middle[0] + size, middle[1] + size], "normal", &range(rows));
    }
    for (body, center) in &used {
        let [x, y] = place(*center);
        let fill = color(*body);
        let _ =
            writeln!(svg, "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"{size:.1}\" fill=\"{fill}\"/>");
        write([x, y], "bold", picture.name(*body));
    }
    svg.push_str(&texts);
    place(low)[1] + MARGIN
}

impl Picture {
    fn name(&self, body: u32) -> &str {
        self.bodies.get(body as usize).map_or("", |(name, _)| name)
    }

    /// Returns the mean of the points of some rows.
    fn mean(&self, rows: &[usize]) -> Point {
        let part = 1.0 / rows.len() as f64;
        rows.iter().fold([0.0; 2], |sum, &i| {
            let [x, y] = self.rows[i].point;
            [sum[0] + part * x, sum[1] + part * y]
        })
    }
}

/// Draws a contact or a joint as a square, with a line of this style to each of its bodies.
fn link(svg: &mut String, ([x, y], style): (Point, &str), bodies: impl Iterator<Item = Point>) {
    for [from_x, from_y] in bodies {
        let _ = writeln!(
            svg,
            "<line x1=\"{from_x:.1}\" y1=\"{from_y:.1}\" x2=\"{x:.1}\" y2=\"{y:.1}\" \
             stroke=\"#999999\"{style}/>"
        );
    }
    let _ = writeln!(
        svg,
        "<rect x=\"{:.1}\" y=\"{:.1}\" width=\"4\" height=\"4\" fill=\"#444444\"/>",
        x - 2.0,
        y - 2.0
    );
}

/// Draws the normal of a contact as a line with a disc at its tip, on the side of body a.
fn normal(svg: &mut String, [x, y]: Point, [right, up]: Point) {
    let tip = [x + NORMAL * right, y - NORMAL * up];
    let _ = writeln!(
        svg,
        "<line x1=\"{x:.1}\" y1=\"{y:.1}\" x2=\"{:.1}\" y2=\"{:.1}\" stroke=\"#cc0000\"/>\n\
         <circle cx=\"{:.1}\" cy=\"{:.1}\" r=\"2\" fill=\"#cc0000\"/>",
        tip[0], tip[1], tip[0], tip[1]
    );
}

/// Formats the numbers of the contacts or rows of two bodies, from 1; these are consecutive.
fn range(rows: &[usize]) -> String {
    match rows {
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
