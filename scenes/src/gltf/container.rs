//! The files of a scene: JSON, and buffers in it, beside it or behind it.

use std::io::Read;
use std::path::{Component, Path, PathBuf};

use gltf::json::Root;

use super::{Detail, ENVIRONMENT_EXTENSION, MATERIAL_EXTENSION, MAX_BYTES, UNPACK};
use crate::{Error, Result, file};

/// A parsed file and its buffers' bytes.
pub(super) struct Container {
    pub(super) root: Root,
    pub(super) buffers: Vec<Vec<u8>>,
}

/// Extensions that a file may require and that are read.
const KNOWN_EXTENSIONS: [&str; 4] = [
    MATERIAL_EXTENSION,
    ENVIRONMENT_EXTENSION,
    "KHR_lights_punctual",
    "KHR_mesh_quantization",
];
/// Beginnings of the names of extensions that say how textures and other materials look, which are not shown anyway.
const LOOKS: [&str; 3] = ["KHR_materials_", "KHR_texture_", "EXT_texture_"];
/// Extensions that compress meshes.
const COMPRESSION: [&str; 3] = [
    "KHR_draco_mesh_compression",
    "EXT_meshopt_compression",
    "KHR_meshopt_compression",
];

impl Container {
    pub(super) fn read(path: &Path) -> Result<Self> {
        let bytes = file::read(path, MAX_BYTES)?;
        Self::parse(path, &bytes, |uri, length| beside(path, uri, length))
    }

    /// A file that is in memory already; `path` is its name in messages. Buffers that are neither in it nor behind it are read by
    /// their relative URI and length.
    pub(super) fn parse(
        path: &Path,
        bytes: &[u8],
        mut read: impl FnMut(&str, u64) -> Detail<Vec<u8>>,
    ) -> Result<Self> {
        let invalid = |detail| Error::Invalid {
            path: path.into(),
            detail,
        };
        let (json, blob) = split(bytes).map_err(invalid)?;
        let root: Root = gltf::json::deserialize::from_slice(json).map_err(|error| {
            invalid(format!(
                "not glTF 2.0: {error}; export the scene as .gltf or .glb"
            ))
        })?;
        if !root.asset.version.starts_with("2.") {
            return Err(invalid(format!(
                "glTF version {:?}; version 2.0 is read",
                root.asset.version
            )));
        }
        for required in &root.extensions_required {
            if COMPRESSION.contains(&required.as_str()) {
                return Err(invalid(format!("requires the extension {required}; {UNPACK}")));
            }
            let read = KNOWN_EXTENSIONS.contains(&required.as_str());
            if !read && !LOOKS.iter().any(|look| required.starts_with(look)) {
                return Err(invalid(format!(
                    "requires the extension {required}; export the scene without it"
                )));
            }
        }
        let mut left = MAX_BYTES;
        let mut buffers = Vec::with_capacity(root.buffers.len());
        for (index, buffer) in root.buffers.iter().enumerate() {
            let length = buffer.byte_length.0;
            left = left.checked_sub(length).ok_or_else(|| {
                invalid(format!(
                    "buffers[{index}] has {length} bytes; all together may have {MAX_BYTES}"
                ))
            })?;
            let mut data = match &buffer.uri {
                None if index == 0 => blob.map(<[u8]>::to_vec).ok_or_else(|| {
                    invalid(
                        "buffers[0] has no uri, and the file has no binary chunk: add one or the other"
                            .into(),
                    )
                })?,
                None => return Err(invalid(format!("buffers[{index}] has no uri"))),
                Some(uri) => match uri.strip_prefix("data:") {
                    Some(data) => embedded(data),
                    None => read(uri, length),
                }
                .map_err(|detail| invalid(format!("buffers[{index}]: {detail}")))?,
            };
            if (data.len() as u64) < length {
                let found = data.len();
                return Err(invalid(format!(
                    "buffers[{index}] has {found} bytes where byteLength says {length}: the file is cut short"
                )));
            }
            data.truncate(length as usize);
            buffers.push(data);
        }
        Ok(Self { root, buffers })
    }
}

/// JSON and binary chunk of a `.glb`, or all of a `.gltf` (glTF 2.0, section 4.4).
fn split(bytes: &[u8]) -> Detail<(&[u8], Option<&[u8]>)> {
    if !bytes.starts_with(b"glTF") {
        return Ok((bytes, None));
    }
    let word = |at: usize| -> Detail<usize> {
        let word = bytes.get(at..at + 4).and_then(|word| word.try_into().ok());
        word.map(|word| u32::from_le_bytes(word) as usize)
            .ok_or_else(|| format!("ends at byte {at}, inside a header"))
    };
    let version = word(4)?;
    if version != 2 {
        return Err(format!("glb version {version}; version 2 is read"));
    }
    let chunk = |at: usize, name: &str| -> Detail<(&[u8], &[u8])> {
        let (length, kind) = (word(at)?, word(at + 4)?.to_le_bytes());
        let data = bytes.get(at + 8..).and_then(|rest| rest.get(..length));
        let data =
            data.ok_or_else(|| format!("chunk at byte {at} has {length} bytes, beyond the file's end"))?;
        if &kind[..4] != name.as_bytes() {
            return Err(format!(
                "chunk at byte {at} is {:?} instead of {name:?}",
                String::from_utf8_lossy(&kind[..4])
            ));
        }
        Ok((data, &bytes[at + 8 + length..]))
    };
    let (json, rest) = chunk(12, "JSON")?;
    let blob = if rest.is_empty() {
        None
    } else {
        Some(chunk(bytes.len() - rest.len(), "BIN\0")?.0)
    };
    Ok((json, blob))
}

/// Bytes of a `data:` address, which must be base64.
fn embedded(data: &str) -> Detail<Vec<u8>> {
    let (_, text) = data
        .split_once(";base64,")
        .ok_or("a data uri that is not base64")?;
    let mut bytes = Vec::with_capacity(text.len() / 4 * 3);
    let (mut bits, mut count) = (0u32, 0);
    for (at, symbol) in text.trim_end_matches('=').bytes().enumerate() {
        let value = match symbol {
            b'A'..=b'Z' => symbol - b'A',
            b'a'..=b'z' => symbol - b'a' + 26,
            b'0'..=b'9' => symbol - b'0' + 52,
            b'+' | b'-' => 62,
            b'/' | b'_' => 63,
            _ => return Err(format!("character {at} of the data uri is not base64")),
        };
        bits = bits << 6 | u32::from(value);
        count += 6;
        if count >= 8 {
            count -= 8;
            bytes.push((bits >> count) as u8);
        }
    }
    Ok(bytes)
}

/// The first `length` bytes of a file below the scene's folder.
fn beside(scene: &Path, uri: &str, length: u64) -> Detail<Vec<u8>> {
    let relative = below(uri)?;
    let folder = match scene.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    };
    let failed = |error: std::io::Error| format!("{}: {error}", folder.join(&relative).display());
    let path = folder.join(&relative).canonicalize().map_err(failed)?;
    // A link may lead out where the name does not.
    if !path.starts_with(folder.canonicalize().map_err(failed)?) {
        return Err(format!(
            "uri {uri:?} leads out of the scene's folder; put the file below it"
        ));
    }
    let file = std::fs::File::open(&path).map_err(failed)?;
    if !file.metadata().map_err(failed)?.is_file() {
        return Err(format!("uri {uri:?} is not a regular file"));
    }
    let mut bytes = Vec::new(); // grows with what is there, not with what the scene says
    file.take(length).read_to_end(&mut bytes).map_err(failed)?;
    Ok(bytes)
}

/// The path of a buffer below the scene's folder.
fn below(uri: &str) -> Detail<PathBuf> {
    let relative = PathBuf::from(percent_decoded(uri)?);
    let inside = relative
        .components()
        .all(|part| matches!(part, Component::Normal(_) | Component::CurDir));
    if !inside || uri.contains(':') || uri.contains('\\') {
        return Err(format!(
            "uri {uri:?} leads out of the scene's folder; put the file below it"
        ));
    }
    Ok(relative)
}

/// URIs of the buffers of a file in memory that lie beside it, as they are written there.
pub(super) fn externals(bytes: &[u8]) -> Detail<Vec<String>> {
    let (json, _) = split(bytes)?;
    let root: Root = gltf::json::deserialize::from_slice(json)
        .map_err(|error| format!("not glTF 2.0: {error}; export the scene as .gltf or .glb"))?;
    let uris = root.buffers.into_iter().filter_map(|buffer| buffer.uri);
    uris.filter(|uri| !uri.starts_with("data:"))
        .map(|uri| below(&uri).map(|_| uri))
        .collect()
}

fn percent_decoded(uri: &str) -> Detail<String> {
    let mut bytes = Vec::with_capacity(uri.len());
    let mut rest = uri.bytes();
    while let Some(byte) = rest.next() {
        if byte != b'%' {
            bytes.push(byte);
            continue;
        }
        let mut digit = || rest.next().and_then(|digit| char::from(digit).to_digit(16));
        let (high, low) = (digit(), digit());
        match (high, low) {
            (Some(high), Some(low)) => bytes.push((high * 16 + low) as u8),
            _ => return Err(format!("uri {uri:?} has a % without two hexadecimal digits")),
        }
    }
    String::from_utf8(bytes).map_err(|_| format!("uri {uri:?} is not UTF-8"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn base64_and_percent_codes_decode() {
        assert_eq!(
            embedded("application/octet-stream;base64,TWFueSBoYW5kcw==").unwrap(),
            b"Many hands"
        );
        assert!(embedded("text/plain,abc").unwrap_err().contains("not base64"));
        assert!(embedded(";base64,ab*d").unwrap_err().contains("character 2"));
        assert_eq!(percent_decoded("a%20b.bin").unwrap(), "a b.bin");
        assert!(percent_decoded("a%2").is_err() && percent_decoded("%ff").is_err());
    }

    #[test]
    fn binary_containers_are_split_and_damage_is_named() {
        let mut glb = b"glTF\x02\0\0\0\x24\0\0\0".to_vec();
        glb.extend(b"\x04\0\0\0JSON{}  \x04\0\0\0BIN\0abcd");
        assert_eq!(split(&glb).unwrap(), (&b"{}  "[..], Some(&b"abcd"[..])));
        assert_eq!(split(b"{}").unwrap(), (&b"{}"[..], None));
        for length in 4..glb.len() {
            let result = split(&glb[..length]);
            assert!(
                result.is_err() || (length == 24 && result.unwrap().1.is_none()),
                "{length}"
            );
        }
        glb[12] = 0xff;
        assert!(split(&glb).unwrap_err().contains("beyond the file's end"));
    }
}
