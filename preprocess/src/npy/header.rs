//! The header of a `.npy` file: magic, version, and a Python dictionary with type, order and shape.
//!
//! Parsed by hand and with suspicion: nothing in it is believed before it is compared with the file's length.

use std::io::Read;

/// Longest accepted dictionary; numpy itself refuses more than 10,000 bytes.
const MAX_DICTIONARY_BYTES: usize = 10_000;
/// Most accepted axes.
const MAX_AXES: usize = 32;
const MAGIC: &[u8; 6] = b"\x93NUMPY";

/// Reads the bytes of a header and no more of them than one may have, for [`Header::parse`].
pub(super) fn read(reader: &mut impl Read) -> std::io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    let mut up_to = |length: usize, bytes: &mut Vec<u8>| -> std::io::Result<()> {
        let more = length.saturating_sub(bytes.len()) as u64;
        reader.by_ref().take(more).read_to_end(bytes).map(|_| ())
    };
    up_to(10, &mut bytes)?;
    let length = match bytes[..] {
        [.., 1, _, low, high] => 10 + usize::from(u16::from_le_bytes([low, high])),
        [_, _, _, _, _, _, 2 | 3, ..] => {
            up_to(12, &mut bytes)?;
            let field = bytes.last_chunk().map_or(0, |field| u32::from_le_bytes(*field));
            12 + field as usize
        }
        _ => 0,
    };
    if bytes.starts_with(MAGIC) {
        up_to(length.min(12 + MAX_DICTIONARY_BYTES), &mut bytes)?;
    }
    Ok(bytes)
}

/// A parsed header.
#[derive(Debug, PartialEq)]
pub(super) struct Header {
    /// numpy's name of the type, as "<f2".
    pub(super) descr: String,
    /// Whether the first axis is the fastest.
    pub(super) fortran_order: bool,
    /// Lengths of the axes.
    pub(super) shape: Vec<u64>,
    /// Where the samples begin in the file.
    pub(super) data_offset: usize,
}

impl Header {
    /// Parses the beginning of a file; the error says what was found and expected.
    pub(super) fn parse(bytes: &[u8]) -> Result<Self, String> {
        if bytes.get(..6) != Some(MAGIC) {
            let found = &bytes[..bytes.len().min(6)];
            return Err(format!(
                "begins with {found:02x?}, not with the magic of a .npy file, {MAGIC:02x?}"
            ));
        }
        let truncated = || format!("ends inside the header, after {} bytes", bytes.len());
        let version = bytes.get(6..8).ok_or_else(truncated)?;
        let (length, start) = match version {
            [1, 0] => {
                let field = bytes.get(8..10).ok_or_else(truncated)?;
                (usize::from(u16::from_le_bytes([field[0], field[1]])), 10)
            }
            [2 | 3, 0] => {
                let field = bytes.get(8..12).ok_or_else(truncated)?;
                (
                    u32::from_le_bytes([field[0], field[1], field[2], field[3]]) as usize,
                    12,
                )
            }
            [major, minor] => {
                return Err(format!(
                    "has npy version {major}.{minor}, expected 1.0, 2.0 or 3.0"
                ));
            }
            _ => return Err(truncated()),
        };
        if length > MAX_DICTIONARY_BYTES {
            return Err(format!(
                "claims a header of {length} bytes, more than {MAX_DICTIONARY_BYTES}"
            ));
        }
        let data_offset = start + length;
        let text = bytes.get(start..data_offset).ok_or_else(truncated)?;
        let text =
            std::str::from_utf8(text).map_err(|error| format!("has a header that is no text: {error}"))?;
        let mut parser = Parser { text, position: 0 };
        let (descr, fortran_order, shape) = parser.dictionary().map_err(|detail| {
            format!(
                "has a header that is not understood: {detail} at character {} of {:?}",
                parser.position,
                text.trim_end()
            )
        })?;
        Ok(Self {
            descr,
            fortran_order,
            shape,
            data_offset,
        })
    }

    /// The bytes of a version 1.0 header for an array in C order. Samples begin at a multiple of 64 bytes.
    pub(super) fn write(descr: &str, shape: &[usize]) -> Vec<u8> {
        let mut axes = String::new();
        for axis in shape {
            axes.push_str(&format!("{axis}, "));
        }
        let shape = if shape.len() == 1 {
            axes.trim_end()
        } else {
            axes.trim_end_matches(", ")
        };
        let mut dictionary = format!("{{'descr': '{descr}', 'fortran_order': False, 'shape': ({shape}), }}");
        let unpadded = 10 + dictionary.len() + 1;
        dictionary.push_str(&" ".repeat(unpadded.next_multiple_of(64) - unpadded));
        dictionary.push('\n');
        let mut bytes = MAGIC.to_vec();
        bytes.extend([1, 0]);
        bytes.extend((dictionary.len() as u16).to_le_bytes());
        bytes.extend(dictionary.as_bytes());
        bytes
    }
}

/// A reader of the few Python literals that numpy writes.
struct Parser<'a> {
    text: &'a str,
    position: usize,
}

impl<'a> Parser<'a> {
    fn rest(&self) -> &'a str {
        &self.text[self.position..]
    }

    fn skip_space(&mut self) {
        self.position = self.text.len() - self.rest().trim_start().len();
    }

    fn accept(&mut self, token: &str) -> bool {
        self.skip_space();
        let found = self.rest().starts_with(token);
        self.position += if found { token.len() } else { 0 };
        found
    }

    fn expect(&mut self, token: &str) -> Result<(), String> {
        if self.accept(token) {
            Ok(())
        } else {
            Err(format!("expected {token:?}"))
        }
    }

    fn string(&mut self) -> Result<&'a str, String> {
        let quote = if self.accept("'") {
            '\''
        } else if self.accept("\"") {
            '"'
        } else {
            return Err("expected a quoted string".into());
        };
        let length = self.rest().find(quote).ok_or("a string does not end")?;
        let string = &self.rest()[..length];
        self.position += length + 1;
        Ok(string)
    }

    fn boolean(&mut self) -> Result<bool, String> {
        if self.accept("True") {
            return Ok(true);
        }
        self.expect("False")
            .map(|()| false)
            .map_err(|_| "expected True or False".into())
    }

    fn number(&mut self) -> Result<u64, String> {
        self.skip_space();
        let rest = self.rest();
        let digits = rest.len() - rest.trim_start_matches(|c: char| c.is_ascii_digit()).len();
        let number = rest[..digits]
            .parse()
            .map_err(|_| "expected a length of 64 bits".to_string())?;
        self.position += digits;
        self.accept("L"); // Python 2 wrote its long integers so
        Ok(number)
    }

    fn tuple(&mut self) -> Result<Vec<u64>, String> {
        self.expect("(")?;
        let mut axes = Vec::new();
        while !self.accept(")") {
            if axes.len() == MAX_AXES {
                return Err(format!("more than {MAX_AXES} axes"));
            }
            axes.push(self.number()?);
            if !self.accept(",") {
                self.expect(")")?;
                break;
            }
        }
        Ok(axes)
    }

    fn dictionary(&mut self) -> Result<(String, bool, Vec<u64>), String> {
        let (mut descr, mut order, mut shape) = (None, None, None);
        self.expect("{")?;
        while !self.accept("}") {
            let key = self.string()?;
            self.expect(":")?;
            match key {
                "descr" => {
                    descr = Some(
                        self.string()
                            .map_err(|_| "expected one plain type as descr")?
                            .to_owned(),
                    )
                }
                "fortran_order" => order = Some(self.boolean()?),
                "shape" => shape = Some(self.tuple()?),
                _ => return Err(format!("unknown key {key:?}")),
            }
            if !self.accept(",") {
                self.expect("}")?;
                break;
            }
        }
        self.skip_space();
        if !self.rest().is_empty() {
            return Err("expected the end".into());
        }
        match (descr, order, shape) {
            (Some(descr), Some(order), Some(shape)) => Ok((descr, order, shape)),
            _ => Err("expected the keys descr, fortran_order and shape".into()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn version_1(dictionary: &str) -> Vec<u8> {
        let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
        bytes.extend((dictionary.len() as u16).to_le_bytes());
        bytes.extend(dictionary.as_bytes());
        bytes
    }

    #[test]
    fn written_headers_are_read() {
        for shape in [&[][..], &[7], &[1, 2, 3, 4, 5]] {
            let bytes = Header::write("<f4", shape);
            assert_eq!(bytes.len() % 64, 0);
            let header = Header::parse(&bytes).unwrap();
            assert_eq!(
                header.shape,
                shape.iter().map(|&axis| axis as u64).collect::<Vec<_>>()
            );
            assert_eq!((header.descr.as_str(), header.fortran_order), ("<f4", false));
            assert_eq!(header.data_offset, bytes.len());
        }
    }

    #[test]
    fn other_versions_and_spellings_are_read() {
        let dictionary = "{\"shape\":(2L, 3,), 'fortran_order' : True,'descr':'<f2'}\n";
        let mut bytes = b"\x93NUMPY\x02\x00".to_vec();
        bytes.extend((dictionary.len() as u32).to_le_bytes());
        bytes.extend(dictionary.as_bytes());
        let header = Header::parse(&bytes).unwrap();
        assert_eq!(
            (header.shape.as_slice(), header.fortran_order),
            (&[2, 3][..], true)
        );
        bytes[6] = 3;
        assert_eq!(Header::parse(&bytes).unwrap(), header);
        bytes[6] = 4;
        assert!(Header::parse(&bytes).unwrap_err().contains("version 4.0"));
    }

    #[test]
    fn lies_are_refused_with_a_reason() {
        let huge = "{'descr': '<f2', 'fortran_order': False, 'shape': (99999999999999999999999, 1), }";
        for (dictionary, reason) in [
            ("", "expected \"{\""),
            ("{'descr': '<f2', 'fortran_order': False, }", "expected the keys"),
            (
                "{'descr': [('a', '<f2')], 'fortran_order': False, 'shape': (1,), }",
                "plain type",
            ),
            (
                "{'descr': '<f2', 'fortran_order': Maybe, 'shape': (1,), }",
                "True or False",
            ),
            (
                "{'descr': '<f2', 'fortran_order': False, 'shape': (-1,), }",
                "64 bits",
            ),
            (huge, "64 bits"),
            (
                "{'descr': '<f2', 'fortran_order': False, 'shape': (1,), 'x': 1}",
                "unknown key",
            ),
            (
                "{'descr': '<f2', 'fortran_order': False, 'shape': (1,), } 1",
                "expected the end",
            ),
            ("{'descr", "does not end"),
        ] {
            let error = Header::parse(&version_1(dictionary)).unwrap_err();
            assert!(error.contains(reason), "{dictionary}: {error}");
        }
        let many = format!(
            "{{'descr': '<f2', 'fortran_order': False, 'shape': ({}), }}",
            "1,".repeat(40)
        );
        assert!(Header::parse(&version_1(&many)).unwrap_err().contains("axes"));
        assert!(Header::parse(b"P6 1 1 255").unwrap_err().contains("magic"));
        assert!(
            Header::parse(b"\x93NUMPY\x02\x00\xff\xff\xff\xff")
                .unwrap_err()
                .contains("claims")
        );
        let whole = Header::write("<f2", &[1, 1, 3, 2, 2]);
        for length in 0..whole.len() {
            assert!(Header::parse(&whole[..length]).is_err());
        }
    }
}
