//! Parser of layers in text form.

use super::layer::{Edit, Layer, MetadataEntry, Spec, Specifier, Value};
use super::lexer::{Fault, Lexer, Token};
use super::tokens::{Parser, expected};

/// Start of every layer in text form.
const HEADER: &str = "#usda 1.";

/// Parses a layer.
pub(super) fn parse(text: String) -> Result<Layer, (Fault, String)> {
    match whole(&text) {
        Ok((root, prims)) => Ok(Layer { text, root, prims }),
        Err(fault) => Err((fault, text)),
    }
}

fn whole(text: &str) -> Result<(Spec, usize), Fault> {
    let body = text.strip_prefix('\u{feff}').unwrap_or(text);
    let first = body.lines().next().unwrap_or("");
    if !first.starts_with(HEADER) {
        let value = if body.starts_with("PXR-USDC") || body.starts_with("PK") {
            "binary"
        } else {
            "not '#usda 1.0'"
        };
        let accepted =
            "accepted: OpenUSD in text form; usdcat IN -o OUT.usda makes it of any other";
        return Err(Fault::new(0, "the first line", value, accepted));
    }
    let start = text.len().saturating_sub(body.len()).saturating_add(first.len());
    let mut parser = Parser { lexer: Lexer::new(text, start), held: None, depth: 0, prims: 0 };
    let mut root = Spec::new(0, Specifier::Def);
    parser.metadata(&mut root)?;
    loop {
        match parser.next()? {
            (Token::End, _) => return Ok((root, parser.prims)),
            (Token::Word(word), at) => {
                if !parser.prim(word, at, &mut root)? {
                    return Err(expected(at, &Token::Word(word), "def, over or class"));
                }
            }
            (Token::Mark(';'), _) => {}
            (other, at) => return Err(expected(at, &other, "def, over or class")),
        }
    }
}

impl<'a> Parser<'a> {
    /// Parses a prim if `word` starts one.
    fn prim(&mut self, word: &str, at: usize, parent: &mut Spec) -> Result<bool, Fault> {
        let specifier = match word {
            "def" => Specifier::Def,
            "over" => Specifier::Over,
            "class" => Specifier::Class,
            "reorder" => {
                self.next()?;
                self.need('=')?;
                self.value(false)?;
                return Ok(true);
            }
            _ => return Ok(false),
        };
        let mut spec = Spec::new(at, specifier);
        if let Token::Word(kind) = self.peek()?.0 {
            spec.kind = kind.to_owned();
            self.held = None;
        }
        let (name, place) = self.text("the name of the prim")?;
        if name.is_empty() || name.contains(['/', '.', '{', '<', '>']) {
            let accepted = "accepted: letters, digits and underscores";
            return Err(Fault::new(place, "the name of a prim", format!("{name:?}"), accepted));
        }
        self.deeper(at, |parser| parser.contents(&mut spec))?;
        self.prims = self.prims.saturating_add(1);
        if !parent.adopt(&name, spec) {
            let accepted = "accepted: each name once beside each other";
            return Err(Fault::new(place, "the name of a prim", format!("{name:?}"), accepted));
        }
        Ok(true)
    }

    /// Parses the metadata of a prim and the contents of its braces.
    fn contents(&mut self, spec: &mut Spec) -> Result<(), Fault> {
        self.metadata(spec)?;
        self.need('{')?;
        loop {
            match self.next()? {
                (Token::Mark('}'), _) => return Ok(()),
                (Token::Mark(';'), _) => {}
                (Token::Word("variantSet"), at) => self.variant_set(spec, at)?,
                (Token::Word(word), at) => {
                    if !self.prim(word, at, spec)? {
                        self.property(word, at, spec)?;
                    }
                }
                (other, at) => return Err(expected(at, &other, "a property, a prim or '}'")),
            }
        }
    }

    fn variant_set(&mut self, spec: &mut Spec, at: usize) -> Result<(), Fault> {
        let (set, _) = self.text("the name of the variant set")?;
        self.need('=')?;
        self.need('{')?;
        loop {
            match self.next()? {
                (Token::Mark('}'), _) => return Ok(()),
                (Token::Text(name), _) => {
                    let mut variant = Spec::new(at, Specifier::Over);
                    self.deeper(at, |parser| parser.contents(&mut variant))?;
                    spec.variants.entry(set.clone()).or_default().insert(name, variant);
                }
                (other, at) => return Err(expected(at, &other, "the name of a variant or '}'")),
            }
        }
    }

    /// Parses the metadata in parentheses after a name, if there are any.
    fn metadata(&mut self, spec: &mut Spec) -> Result<(), Fault> {
        for (key, entry) in self.entries()? {
            spec.metadata.entry(key).or_default().push(entry);
        }
        Ok(())
    }

    fn entries(&mut self) -> Result<Vec<(String, MetadataEntry)>, Fault> {
        let mut entries = Vec::new();
        if !self.mark('(')? {
            return Ok(entries);
        }
        loop {
            let (edit, token, at) = match self.next()? {
                (Token::Mark(')'), _) => return Ok(entries),
                (Token::Text(_) | Token::Mark(',' | ';'), _) => continue,
                (Token::Word(word), at) => match (edit(word), &self.peek()?.0) {
                    (Some(edit), Token::Word(_)) => {
                        let (token, at) = self.next()?;
                        (edit, token, at)
                    }
                    _ => (Edit::Replace, Token::Word(word), at),
                },
                (other, at) => return Err(expected(at, &other, "metadata or ')'")),
            };
            let Token::Word(key) = token else { return Err(expected(at, &token, "a name")) };
            self.need('=')?;
            let value = match key {
                // The reader does not use their contents.
                "relocates" | "customData" | "customLayerData" | "assetInfo" | "clips"
                | "sdrMetadata" => {
                    self.skip_block()?;
                    Value::Other
                }
                _ => self.value(true)?,
            };
            entries.push((key.to_owned(), MetadataEntry { edit, value, at }));
        }
    }

    /// Skips a value with everything inside its brackets.
    fn skip_block(&mut self) -> Result<(), Fault> {
        let mut open = 0_usize;
        loop {
            match self.next()? {
                (Token::Mark('{' | '[' | '('), _) => open = open.saturating_add(1),
                (Token::Mark('}' | ']' | ')'), _) => open = open.saturating_sub(1),
                (end @ Token::End, at) => return Err(expected(at, &end, "'}'")),
                _ => {}
            }
            if open == 0 {
                return Ok(());
            }
        }
    }

    /// Parses a property that starts with the word `first`.
    fn property(&mut self, first: &'a str, start: usize, spec: &mut Spec) -> Result<(), Fault> {
        let (mut word, mut place, mut edits) = (first, start, Edit::Replace);
        loop {
            match word {
                "custom" | "varying" | "uniform" | "config" => {}
                other => match edit(other) {
                    Some(edit) => edits = edit,
                    None => break,
                },
            }
            match self.next()? {
                (Token::Word(next), at) => (word, place) = (next, at),
                (other, at) => return Err(expected(at, &other, "a type and a name")),
            }
        }
        if word == "rel" {
            return self.relationship(edits, spec);
        }
        let list = self.mark('[')?;
        if list {
            self.need(']')?;
        }
        let (token, at) = self.next()?;
        let Token::Word(name) = token else {
            let accepted = format!("the name of an attribute after {}", Token::Word(word).label());
            return Err(expected(at.max(place), &token, &accepted));
        };
        let suffix = if self.mark('.')? {
            match self.next()? {
                (Token::Word(suffix), _) => suffix,
                (other, at) => return Err(expected(at, &other, "timeSamples or connect")),
            }
        } else {
            ""
        };
        self.entries()?;
        let mut value = None;
        let mut samples = None;
        if self.mark('=')? {
            match suffix {
                "" | "default" => value = Some(self.typed(word, list, name)?),
                "timeSamples" => samples = Some(self.samples(word, list, name)?),
                // A spline, or the source of a connection.
                _ => self.skip_block()?,
            }
            self.entries()?;
        }
        let property = spec.properties.entry(name.to_owned()).or_default();
        property.at = at;
        property.value = value.or(property.value.take());
        property.samples = samples.or(property.samples.take());
        Ok(())
    }

    fn relationship(&mut self, edit: Edit, spec: &mut Spec) -> Result<(), Fault> {
        let (token, at) = self.next()?;
        let Token::Word(name) = token else {
            return Err(expected(at, &token, "the name of a relationship"));
        };
        self.entries()?;
        let property = spec.properties.entry(name.to_owned()).or_default();
        property.at = at;
        if self.mark('=')? {
            let value = self.value(false)?;
            if !matches!(value, Value::Targets(_) | Value::Blocked)
                && value != Value::Numbers(Vec::new())
            {
                let accepted = "accepted: </Path/Of/A/Prim>, or a list of such";
                return Err(Fault::new(at, name, value.label(), accepted));
            }
            let property = spec.properties.entry(name.to_owned()).or_default();
            property.targets.push(MetadataEntry { edit, value, at });
            self.entries()?;
        }
        Ok(())
    }

    fn samples(&mut self, kind: &str, list: bool, name: &str) -> Result<Vec<(f64, Value)>, Fault> {
        self.need('{')?;
        let mut samples = Vec::new();
        loop {
            match self.next()? {
                (Token::Mark('}'), _) => break,
                (Token::Mark(','), _) => {}
                (Token::Number(code), at) if code.is_finite() => {
                    self.need(':')?;
                    let value = self.typed(kind, list, name)?;
                    let accepted = "accepted: each time code once";
                    if samples.last().is_some_and(|(last, _)| *last == code) {
                        return Err(Fault::new(at, "a time code", format!("{code:?}"), accepted));
                    }
                    samples.push((code, value));
                }
                (other, at) => return Err(expected(at, &other, "a time code or '}'")),
            }
        }
        samples.sort_by(|(a, _), (b, _)| a.total_cmp(b));
        Ok(samples)
    }
}

/// Returns the list edit that a keyword stands for.
fn edit(word: &str) -> Option<Edit> {
    Some(match word {
        "prepend" => Edit::Prepend,
        "append" | "add" => Edit::Append,
        "delete" => Edit::Delete,
        "reorder" => Edit::Reorder,
        _ => return None,
    })
}
