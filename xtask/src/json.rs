//! Reads the JSON of `rig diagnose --json`, since this crate has no dependencies.

/// Lists and objects inside each other beyond this depth are refused: the reader
/// calls itself for each.
const DEEPEST: usize = 64;

/// A value.
#[derive(Clone, Debug, PartialEq)]
pub enum Value {
    /// `null`.
    Null,
    /// `true` or `false`.
    Bool(bool),
    /// A number.
    Number(f64),
    /// A string, without its escapes.
    Text(String),
    /// A list.
    List(Vec<Value>),
    /// An object, in the order of the text.
    Object(Vec<(String, Value)>),
}

impl Value {
    /// Reads a text; none if it is not JSON.
    pub fn parse(text: &str) -> Option<Self> {
        let mut reader = Reader { rest: text };
        let value = reader.value(0)?;
        reader.skip_space();
        reader.rest.is_empty().then_some(value)
    }

    /// The value of a key; none if this is no object or has no such key.
    pub fn get(&self, key: &str) -> Option<&Self> {
        match self {
            Self::Object(pairs) => pairs.iter().find(|(k, _)| k == key).map(|(_, v)| v),
            _ => None,
        }
    }

    /// The text, if it is one.
    pub fn text(&self) -> Option<&str> {
        match self {
            Self::Text(text) => Some(text),
            _ => None,
        }
    }

    /// The number, if it is one.
    pub fn number(&self) -> Option<f64> {
        match self {
            Self::Number(number) => Some(*number),
            _ => None,
        }
    }

    /// The items of a list; nothing for anything else.
    pub fn items(&self) -> &[Self] {
        match self {
            Self::List(items) => items,
            _ => &[],
        }
    }
}

struct Reader<'t> {
    rest: &'t str,
}

impl Reader<'_> {
    fn skip_space(&mut self) {
        self.rest = self.rest.trim_start_matches([' ', '\t', '\n', '\r']);
    }

    fn take(&mut self, token: &str) -> Option<()> {
        self.skip_space();
        self.rest = self.rest.strip_prefix(token)?;
        Some(())
    }

    fn value(&mut self, depth: usize) -> Option<Value> {
        if depth > DEEPEST {
            return None;
        }
        self.skip_space();
        match self.rest.as_bytes().first()? {
            b'n' => self.take("null").map(|()| Value::Null),
            b't' => self.take("true").map(|()| Value::Bool(true)),
            b'f' => self.take("false").map(|()| Value::Bool(false)),
            b'"' => self.string().map(Value::Text),
            b'[' => {
                self.take("[")?;
                let mut items = Vec::new();
                if self.take("]").is_some() {
                    return Some(Value::List(items));
                }
                loop {
                    items.push(self.value(depth + 1)?);
                    if self.take(",").is_none() {
                        return self.take("]").map(|()| Value::List(items));
                    }
                }
            }
            b'{' => {
                self.take("{")?;
                let mut pairs = Vec::new();
                if self.take("}").is_some() {
                    return Some(Value::Object(pairs));
                }
                loop {
                    self.skip_space();
                    let key = self.string()?;
                    self.take(":")?;
                    pairs.push((key, self.value(depth + 1)?));
                    if self.take(",").is_none() {
                        return self.take("}").map(|()| Value::Object(pairs));
                    }
                }
            }
            _ => {
                let is_part = |c: char| c.is_ascii_digit() || "+-.eE".contains(c);
                let end = self.rest.find(|c| !is_part(c)).unwrap_or(self.rest.len());
                let number = self.rest[..end].parse().ok()?;
                self.rest = &self.rest[end..];
                Some(Value::Number(number))
            }
        }
    }

    fn string(&mut self) -> Option<String> {
        let mut text = String::new();
        let mut chars = self.rest.strip_prefix('"')?.chars();
        loop {
            match chars.next()? {
                '"' => break,
                '\\' => text.push(match chars.next()? {
                    'n' => '\n',
                    't' => '\t',
                    'r' => '\r',
                    'b' => '\u{8}',
                    'f' => '\u{c}',
                    'u' => {
                        let digits = chars.as_str().get(..4)?;
                        let code = u32::from_str_radix(digits, 16).ok()?;
                        chars = chars.as_str()[4..].chars();
                        // Half of a pair: kept as a mark that something stood here.
                        char::from_u32(code).unwrap_or(char::REPLACEMENT_CHARACTER)
                    }
                    other => other,
                }),
                other => text.push(other),
            }
        }
        self.rest = chars.as_str();
        Some(text)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_read() {
        let value = Value::parse(
            r#" { "a": [1, -2.5e1, true, null, []], "b\n\u00b0\"": "x\\y", "c": {"d": false} } "#,
        )
        .unwrap();
        let numbers: Vec<_> = value
            .get("a")
            .unwrap()
            .items()
            .iter()
            .map(Value::number)
            .collect();
        assert_eq!(numbers, [Some(1.0), Some(-25.0), None, None, None]);
        assert_eq!(value.get("b\n°\"").and_then(Value::text), Some("x\\y"));
        let inner = value.get("c").and_then(|c| c.get("d"));
        assert_eq!(inner, Some(&Value::Bool(false)));
        assert_eq!(value.get("d"), None);
        assert_eq!(inner.unwrap().get("d"), None);
        assert!(value.items().is_empty());
    }

    #[test]
    fn what_is_no_json_is_none() {
        let long = "[".repeat(100_000);
        for text in [
            "",
            "{",
            "[1",
            "[1 2]",
            "{\"a\" 1}",
            "\"",
            "\"\\",
            "\"\\u00",
            "\"\\u00°°\"",
            "tru",
            "1 2",
            "-",
            "{a: 1}",
            &long,
        ] {
            assert_eq!(Value::parse(text), None, "{}", &text[..text.len().min(20)]);
        }
    }
}
