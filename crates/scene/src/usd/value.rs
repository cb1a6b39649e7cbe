//! Parser of values in a layer.

use super::layer::{Target, Time, Value};
use super::lexer::{Fault, Token, clipped};
use super::tokens::{Parser, expected};

/// Kind of value that an attribute of a given type holds.
enum ValueKind {
    /// A tuple of this many numbers.
    Numbers(usize),
    Texts,
    /// Anything; not checked.
    Other,
}

/// Returns the kind of a type by its name: `float3`, `point3f`, `quatd`, `matrix4d`, `token`, ...
fn kind_of(name: &str) -> ValueKind {
    ValueKind::Numbers(match name {
        "bool" | "uchar" | "int" | "uint" | "int64" | "uint64" | "half" | "float" | "double"
        | "timecode" => 1,
        "int2" | "half2" | "float2" | "double2" | "texCoord2h" | "texCoord2f" | "texCoord2d" => 2,
        "int3" | "half3" | "float3" | "double3" | "texCoord3h" | "texCoord3f" | "texCoord3d"
        | "point3h" | "point3f" | "point3d" | "vector3h" | "vector3f" | "vector3d" | "normal3h"
        | "normal3f" | "normal3d" | "color3h" | "color3f" | "color3d" => 3,
        "int4" | "half4" | "float4" | "double4" | "color4h" | "color4f" | "color4d" | "quath"
        | "quatf" | "quatd" | "matrix2d" => 4,
        "matrix3d" => 9,
        "matrix4d" | "frame4d" => 16,
        "string" | "token" => return ValueKind::Texts,
        _ => return ValueKind::Other,
    })
}

impl<'a> Parser<'a> {
    /// Parses the value of an attribute of type `kind`, or of a list of that type.
    pub(super) fn typed(&mut self, kind: &str, list: bool, name: &str) -> Result<Value, Fault> {
        let at = self.peek()?.1;
        let value = self.value(false)?;
        let array = if list { "[]" } else { "" };
        let (fits, what) = match kind_of(kind) {
            ValueKind::Other => return Ok(value),
            ValueKind::Texts => {
                let fits = match &value {
                    Value::Text(_) => !list,
                    Value::Texts(_) => list,
                    Value::Numbers(numbers) => list && numbers.is_empty(),
                    other => *other == Value::Blocked,
                };
                (fits, "a text".to_owned())
            }
            ValueKind::Numbers(width) => {
                let fits = match &value {
                    Value::Number(_) => !list && width == 1,
                    // Words such as true.
                    Value::Text(_) => !list && width == 1,
                    Value::Tuple(numbers) => !list && numbers.len() == width && width > 1,
                    Value::Numbers(numbers) => list && (width == 1 || numbers.is_empty()),
                    Value::Tuples(of, _) => list && *of == width,
                    Value::Texts(_) => list && kind == "bool",
                    other => *other == Value::Blocked,
                };
                let what = match width {
                    1 => "a number".to_owned(),
                    _ => format!("{width} numbers in parentheses"),
                };
                (fits, what)
            }
        };
        if fits {
            return Ok(value);
        }
        let what = if list { format!("a list of such: {what}") } else { what };
        Err(Fault::new(at, name, value.label(), format!("accepted for {kind}{array}: {what}")))
    }

    /// Parses any value. With `arcs`, targets may carry time offsets in parentheses.
    pub(super) fn value(&mut self, arcs: bool) -> Result<Value, Fault> {
        let (token, at) = self.next()?;
        Ok(match token {
            Token::Word("None") => Value::Blocked,
            Token::Word("inf") => Value::Number(f64::INFINITY),
            Token::Word("nan") => Value::Number(f64::NAN),
            Token::Number(number) => Value::Number(number),
            Token::Word(word) => Value::Text(word.to_owned()),
            Token::Text(text) => Value::Text(text),
            Token::Mark('(') => self.deeper(at, |parser| parser.tuple())?,
            Token::Mark('[') => self.deeper(at, |parser| parser.list(arcs))?,
            Token::Mark('{') => self.deeper(at, |parser| parser.dictionary())?,
            Token::Path(path) => Value::Targets(vec![self.target(None, path.trim(), at, arcs)?]),
            Token::Asset(asset) => {
                let path = match self.peek()?.0 {
                    Token::Path(path) => {
                        self.held = None;
                        path.trim()
                    }
                    _ => "",
                };
                Value::Targets(vec![self.target(Some(asset.to_owned()), path, at, arcs)?])
            }
            other => return Err(expected(at, &other, "a value")),
        })
    }

    fn target(
        &mut self,
        asset: Option<String>,
        path: &str,
        at: usize,
        arcs: bool,
    ) -> Result<Target, Fault> {
        let mut target = Target { asset, path: path.to_owned(), time: Time::SAME, at };
        if !arcs || !self.mark('(')? {
            return Ok(target);
        }
        loop {
            match self.next()? {
                (Token::Mark(')'), _) => return Ok(target),
                (Token::Mark(',' | ';'), _) => {}
                (Token::Word(key), at) => {
                    self.need('=')?;
                    match (key, self.value(false)?) {
                        ("offset", Value::Number(x)) if x.is_finite() => target.time.offset = x,
                        ("scale", Value::Number(x)) if x.is_finite() => target.time.scale = x,
                        ("offset" | "scale", other) => {
                            let accepted = "accepted: a finite number";
                            return Err(Fault::new(at, key, other.label(), accepted));
                        }
                        _ => {}
                    }
                }
                (other, at) => return Err(expected(at, &other, "offset, scale or ')'")),
            }
        }
    }

    /// Parses numbers up to the closing parenthesis; the rows of a matrix have parentheses of their
    /// own.
    fn tuple(&mut self) -> Result<Value, Fault> {
        /// Largest number of components of a vector or matrix.
        const LONGEST: usize = 16;
        let (mut numbers, mut depth, mut all) = (Vec::new(), 1_usize, true);
        while depth > 0 {
            match self.next()? {
                (Token::Mark('('), _) => depth = depth.saturating_add(1),
                (Token::Mark(')'), _) => depth = depth.saturating_sub(1),
                (Token::Mark(','), _) => {}
                (Token::Number(number), _) => numbers.push(number),
                (Token::Word("inf"), _) => numbers.push(f64::INFINITY),
                (Token::Word("nan"), _) => numbers.push(f64::NAN),
                (Token::Text(_), _) => all = false,
                (other, at) => return Err(expected(at, &other, "a number or ')'")),
            }
            if numbers.len() > LONGEST {
                let at = self.peek()?.1;
                let value = format!("more than {LONGEST} numbers");
                return Err(Fault::new(at, "a vector", value, "accepted: 2 to 16 numbers"));
            }
        }
        Ok(if all { Value::Tuple(numbers) } else { Value::Other })
    }

    fn list(&mut self, arcs: bool) -> Result<Value, Fault> {
        let mut list = Value::Numbers(Vec::new());
        let mut first = true;
        loop {
            if self.mark(']')? {
                return Ok(list);
            }
            if self.mark(',')? {
                continue;
            }
            let at = self.peek()?.1;
            let item = self.value(arcs)?;
            if first {
                first = false;
                list = match &item {
                    Value::Number(_) => list,
                    Value::Tuple(numbers) => Value::Tuples(numbers.len().max(1), Vec::new()),
                    Value::Text(_) => Value::Texts(Vec::new()),
                    Value::Targets(_) => Value::Targets(Vec::new()),
                    _ => Value::Other,
                };
            }
            match (&mut list, item) {
                (Value::Numbers(list), Value::Number(number)) => list.push(number),
                (Value::Tuples(width, list), Value::Tuple(numbers)) if numbers.len() == *width => {
                    list.extend(numbers);
                }
                (Value::Texts(list), Value::Text(text)) => list.push(text),
                (Value::Targets(list), Value::Targets(targets)) => list.extend(targets),
                (Value::Other, _) => {}
                (_, other) => {
                    let accepted = "accepted: the same as in the items before it";
                    return Err(Fault::new(at, "an item of a list", other.label(), accepted));
                }
            }
        }
    }

    fn dictionary(&mut self) -> Result<Value, Fault> {
        let mut entries = Vec::new();
        loop {
            let (mut token, mut at) = self.next()?;
            match token {
                Token::Mark('}') => return Ok(Value::Dictionary(entries)),
                Token::Mark(',' | ';') => continue,
                _ => {}
            }
            // The type before the key is skipped.
            if matches!(token, Token::Word(_)) && !matches!(self.peek()?.0, Token::Mark('=')) {
                if self.mark('[')? {
                    self.need(']')?;
                }
                (token, at) = self.next()?;
            }
            let key = match token {
                Token::Word(key) => key.to_owned(),
                Token::Text(key) => key,
                other => return Err(expected(at, &other, "a key or '}'")),
            };
            if !self.mark('=')? {
                let accepted = "accepted: a type, a key, '=' and a value";
                return Err(Fault::new(at, "an entry", clipped(&key), accepted));
            }
            let value = self.value(false)?;
            entries.push((key, value));
        }
    }
}
