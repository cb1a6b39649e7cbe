//! Tables as plain text or Markdown.

/// Rows of cells; the first column is left-aligned, the others are right-aligned.
pub(crate) struct Table {
    rows: Vec<Vec<String>>,
}

impl Table {
    pub(crate) fn new(head: &[&str]) -> Self {
        Self { rows: vec![head.iter().map(ToString::to_string).collect()] }
    }

    pub(crate) fn row(&mut self, cells: Vec<String>) {
        self.rows.push(cells);
    }

    pub(crate) fn print(&self, markdown: bool) {
        let width = |column: usize| {
            self.rows.iter().map(|row| row[column].chars().count()).max().unwrap_or(0)
        };
        let widths: Vec<usize> = (0..self.rows[0].len()).map(width).collect();
        for (number, row) in self.rows.iter().enumerate() {
            let cells: Vec<String> = row
                .iter()
                .zip(&widths)
                .enumerate()
                .map(|(column, (cell, &width))| match column {
                    0 => format!("{cell:<width$}"),
                    _ => format!("{cell:>width$}"),
                })
                .collect();
            if markdown {
                println!("| {} |", cells.join(" | "));
            } else {
                println!("{}", cells.join("  "));
            }
            if number == 0 {
                let dashes = widths.iter().enumerate().map(|(column, &width)| match column {
                    0 => "-".repeat(width),
                    _ if markdown => "-".repeat(width - 1) + ":",
                    _ => "-".repeat(width),
                });
                let dashes: Vec<String> = dashes.collect();
                if markdown {
                    println!("| {} |", dashes.join(" | "));
                } else {
                    println!("{}", dashes.join("  "));
                }
            }
        }
    }
}

/// Formats a number with three significant digits and at most four decimals.
pub(crate) fn number(x: f64) -> String {
    if !x.is_finite() {
        return "-".to_string();
    }
    let digits = if x.abs() < 1e-4 { 4 } else { 2 - x.abs().log10().floor() as i32 };
    format!("{x:.*}", digits.clamp(0, 4) as usize)
}
