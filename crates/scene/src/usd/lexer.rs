//! Lexer: splits the text of a layer into tokens.

/// A token of a layer.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Token<'a> {
    /// A name with its namespaces.
    Word(&'a str),
    Number(f64),
    /// Text between quotes.
    Text(String),
    /// Text between `@`.
    Asset(&'a str),
    /// Text between `<` and `>`.
    Path(&'a str),
    Mark(char),
    End,
}

impl Token<'_> {
    /// Returns the token as messages show it.
    pub(super) fn label(&self) -> String {
        match self {
            Self::Word(word) => format!("'{}'", clipped(word)),
            Self::Number(number) => format!("{number:?}"),
            Self::Text(text) => format!("{:?}", clipped(text)),
            Self::Asset(asset) => format!("@{}@", clipped(asset)),
            Self::Path(path) => format!("<{}>", clipped(path)),
            Self::Mark(mark) => format!("'{mark}'"),
            Self::End => "the end of the file".to_owned(),
        }
    }
}

/// Longest excerpt of a file in a message. \[character\]
const LONGEST: usize = 60;

/// Returns a text on one line, cut off if it is too long.
pub(super) fn clipped(text: &str) -> String {
    let line = text.replace(['\n', '\r', '\t'], " ");
    if line.chars().count() <= LONGEST {
        return line;
    }
    line.chars().take(LONGEST).chain("...".chars()).collect()
}

/// A fault at an offset. \[byte\]
#[derive(Debug)]
pub(super) struct Fault {
    pub(super) at: usize,
    pub(super) item: String,
    pub(super) value: String,
    pub(super) accepted: String,
}

impl Fault {
    pub(super) fn new(
        at: usize,
        item: impl Into<String>,
        value: impl Into<String>,
        accepted: impl Into<String>,
    ) -> Self {
        Self { at, item: item.into(), value: value.into(), accepted: accepted.into() }
    }
}

/// Splits a text into tokens.
pub(super) struct Lexer<'a> {
    text: &'a str,
    at: usize,
}

impl<'a> Lexer<'a> {
    /// Starts after the header, which takes the first `start` bytes.
    pub(super) fn new(text: &'a str, start: usize) -> Self {
        Self { text, at: start }
    }

    fn rest(&self) -> &'a str {
        self.text.get(self.at..).unwrap_or("")
    }

    fn skip(&mut self, bytes: usize) {
        self.at = self.at.saturating_add(bytes).min(self.text.len());
    }

    /// Skips white space and comments.
    fn skip_space(&mut self) -> Result<(), Fault> {
        loop {
            let rest = self.rest();
            let space = rest.len().saturating_sub(rest.trim_ascii_start().len());
            self.skip(space);
            let rest = self.rest();
            if rest.starts_with('#') || rest.starts_with("//") {
                self.skip(rest.find('\n').unwrap_or(rest.len()));
            } else if rest.starts_with("/*") {
                let end = rest.find("*/").ok_or_else(|| {
                    Fault::new(self.at, "a comment without end", "", "accepted: one that '*/' ends")
                })?;
                self.skip(end.saturating_add(2));
            } else if space == 0 {
                return Ok(());
            }
        }
    }

    /// Returns the next token and its offset.
    pub(super) fn next(&mut self) -> Result<(Token<'a>, usize), Fault> {
        self.skip_space()?;
        let (at, rest) = (self.at, self.rest());
        let Some(first) = rest.chars().next() else { return Ok((Token::End, at)) };
        let token = match first {
            '"' | '\'' => Token::Text(self.quoted(first)?),
            '@' if rest.starts_with("@@@") => Token::Asset(self.between("@@@", "@@@")?),
            '@' => Token::Asset(self.between("@", "@")?),
            '<' => Token::Path(self.between("<", ">")?),
            '0'..='9' | '.' | '-' | '+' if number_follows(rest) => self.number()?,
            c if c.is_alphabetic() || c == '_' => {
                let end = rest.find(|c: char| !(c.is_alphanumeric() || matches!(c, '_' | ':')));
                let word = rest.get(..end.unwrap_or(rest.len())).unwrap_or("");
                self.skip(word.len());
                Token::Word(word)
            }
            mark => {
                self.skip(mark.len_utf8());
                Token::Mark(mark)
            }
        };
        Ok((token, at))
    }

    /// Returns the text between two marks on one line.
    fn between(&mut self, open: &str, close: &str) -> Result<&'a str, Fault> {
        let inner = self.rest().get(open.len()..).unwrap_or("");
        let end = inner.find(close).filter(|end| !inner.get(..*end).unwrap_or("").contains('\n'));
        let end = end.ok_or_else(|| {
            let item = format!("text after '{open}'");
            Fault::new(
                self.at,
                item,
                "without end",
                format!("accepted: '{close}' on the same line"),
            )
        })?;
        self.skip(open.len().saturating_add(end).saturating_add(close.len()));
        Ok(inner.get(..end).unwrap_or(""))
    }

    fn number(&mut self) -> Result<Token<'a>, Fault> {
        let rest = self.rest();
        if rest.starts_with("-inf") || rest.starts_with("+inf") {
            self.skip(4);
            let sign = if rest.starts_with('-') { -1.0 } else { 1.0 };
            return Ok(Token::Number(sign * f64::INFINITY));
        }
        let within = |c: char| c.is_ascii_alphanumeric() || matches!(c, '.' | '+' | '-');
        let end = rest.find(|c| !within(c)).unwrap_or(rest.len());
        let text = rest.get(..end).unwrap_or("");
        let number = text.parse::<f64>().map_err(|_| {
            Fault::new(self.at, "a number", clipped(text), "accepted: 1, -2.5, 3e-4")
        })?;
        self.skip(end);
        Ok(Token::Number(number))
    }

    /// Reads a text between one or three quotes of a kind.
    fn quoted(&mut self, quote: char) -> Result<String, Fault> {
        let triple = quote.to_string().repeat(3);
        let long = self.rest().starts_with(&triple);
        let close = if long { triple } else { quote.to_string() };
        let start = self.at;
        self.skip(close.len());
        let mut out = String::new();
        loop {
            let rest = self.rest();
            if rest.starts_with(&close) {
                self.skip(close.len());
                return Ok(out);
            }
            match rest.chars().next() {
                Some('\\') => out.extend(self.escaped()),
                Some(c) if long || c != '\n' => {
                    // Copies all characters up to the next one that may be special.
                    let plain = rest.find(['\\', quote, '\n']).unwrap_or(rest.len());
                    let piece = rest.get(..plain.max(c.len_utf8())).unwrap_or("");
                    out.push_str(piece);
                    self.skip(piece.len());
                }
                _ => {
                    let accepted = format!("accepted: one that {close} ends");
                    return Err(Fault::new(start, "a text", "without end", accepted));
                }
            }
        }
    }

    /// Returns the character that an escape sequence stands for.
    fn escaped(&mut self) -> Option<char> {
        self.skip(1);
        let rest = self.rest();
        let next = rest.chars().next()?;
        let digits = |skip: usize, most: usize, base: u32| {
            let digits: String =
                rest.chars().skip(skip).take_while(|c| c.is_digit(base)).take(most).collect();
            (u32::from_str_radix(&digits, base).ok(), skip.saturating_add(digits.len()))
        };
        let (code, length) = match next {
            'n' => (Some(10), 1),
            't' => (Some(9), 1),
            'r' => (Some(13), 1),
            'x' => digits(1, 2, 16),
            '0'..='7' => digits(0, 3, 8),
            other => (Some(u32::from(other)), other.len_utf8()),
        };
        self.skip(length);
        code.and_then(char::from_u32)
    }
}

fn number_follows(text: &str) -> bool {
    let unsigned = text.strip_prefix(['-', '+']).unwrap_or(text);
    let digits = unsigned.strip_prefix('.').unwrap_or(unsigned);
    digits.starts_with(|c: char| c.is_ascii_digit())
        || unsigned.len() < text.len() && unsigned.starts_with("inf")
}
