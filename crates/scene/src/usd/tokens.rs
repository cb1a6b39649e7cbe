//! [`Parser`]: access to the tokens of a layer, one at a time.

use super::lexer::{Fault, Lexer, Token};

/// Largest nesting depth of prims and values.
pub(super) const DEEPEST: usize = 64;

/// Returns the error about an unexpected token.
pub(super) fn expected(at: usize, found: &Token<'_>, accepted: &str) -> Fault {
    Fault::new(at, "the text here", found.label(), format!("accepted: {accepted}"))
}

/// Tokens of a layer, with one token of lookahead.
pub(super) struct Parser<'a> {
    pub(super) lexer: Lexer<'a>,
    pub(super) held: Option<(Token<'a>, usize)>,
    pub(super) depth: usize,
    pub(super) prims: usize,
}

impl<'a> Parser<'a> {
    pub(super) fn next(&mut self) -> Result<(Token<'a>, usize), Fault> {
        match self.held.take() {
            Some(held) => Ok(held),
            None => self.lexer.next(),
        }
    }

    pub(super) fn peek(&mut self) -> Result<&(Token<'a>, usize), Fault> {
        let next = self.next()?;
        Ok(self.held.insert(next))
    }

    /// Consumes a mark if it comes next.
    pub(super) fn mark(&mut self, mark: char) -> Result<bool, Fault> {
        let is = self.peek()?.0 == Token::Mark(mark);
        if is {
            self.held = None;
        }
        Ok(is)
    }

    pub(super) fn need(&mut self, mark: char) -> Result<usize, Fault> {
        match self.next()? {
            (Token::Mark(found), at) if found == mark => Ok(at),
            (other, at) => Err(expected(at, &other, &format!("'{mark}'"))),
        }
    }

    pub(super) fn text(&mut self, what: &str) -> Result<(String, usize), Fault> {
        match self.next()? {
            (Token::Text(text), at) => Ok((text, at)),
            (other, at) => Err(expected(at, &other, what)),
        }
    }

    /// Runs `inner` one nesting level deeper.
    ///
    /// # Errors
    /// If the nesting is deeper than [`DEEPEST`].
    pub(super) fn deeper<T>(
        &mut self,
        at: usize,
        inner: impl FnOnce(&mut Self) -> Result<T, Fault>,
    ) -> Result<T, Fault> {
        self.depth = self.depth.saturating_add(1);
        if self.depth > DEEPEST {
            let value = format!("more than {DEEPEST}");
            return Err(Fault::new(at, "the depth", value, format!("accepted: up to {DEEPEST}")));
        }
        let result = inner(self);
        self.depth = self.depth.saturating_sub(1);
        result
    }
}
