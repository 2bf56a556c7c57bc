//! `eigentile inspect`: what an archive holds, and what it costs; what a BTF holds, and what is wrong with it.

mod btf;

use std::fs::File;
use std::io::{Read, Write};
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use clap::Args;
use serde::Serialize;
use tileset::archive::Index;
use tileset::{Archive, Codec, Factorization, Ledger};

use crate::input::InputArguments;
use crate::{bytes, file};

/// Show what an archive or a BTF holds: sizes, directions, errors, and what is missing.
#[derive(Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Arguments {
    /// An archive X.bsvtf; or a BTF: a folder or zip of images, a table of directions, a .btf or .npy file.
    input: PathBuf,
    #[command(flatten)]
    input_arguments: InputArguments,
    /// Prints JSON.
    #[arg(long)]
    json: bool,
}

const EXAMPLES: &str = "\
Examples:
  eigentile inspect tiles/leather.bsvtf
  eigentile inspect tiles/leather.bsvtf --json | jq .errors.total_relative
  eigentile inspect WOOL.zip
  eigentile inspect captures/ --cosine --json

The exit code of a BTF that cannot be preprocessed is 1. In archives, errors are root mean squares of reflectance, in the unit of the BTF's samples.";

/// All there is to say about an archive.
#[derive(Serialize)]
pub(crate) struct Contents {
    name: String,
    generator: String,
    id: String,
    pub(crate) file_bytes: u64,
    /// Records of pages.
    page_bytes: u64,
    /// Records of eigen-ABRDF columns.
    column_bytes: u64,
    /// Header, manifest and directory.
    manifest_bytes: u64,
    width: u32,
    height: u32,
    wrap: bool,
    cosine: bool,
    views: usize,
    lights: usize,
    components: u32,
    groups: u32,
    factorization: Factorization,
    codec: Codec,
    quantizer_step: f64,
    texture_scale: f64,
    mean_rgb: [f64; 3],
    pub(crate) errors: Errors,
    pages: Pages,
    pages_by_mip: Vec<Mip>,
    columns: Columns,
    singular_values: Vec<f64>,
}

/// The ledger and its sum.
#[derive(Serialize)]
pub(crate) struct Errors {
    #[serde(flatten)]
    stages: Ledger,
    pub(crate) total_rms: f64,
    pub(crate) total_relative: f64,
}

#[derive(Serialize)]
struct Pages {
    count: u64,
    /// Those that equal their up-sampled parent are not stored.
    stored: u64,
    largest_bytes: u32,
}

#[derive(Serialize)]
struct Columns {
    count: u64,
    largest_bytes: u32,
}

#[derive(Serialize)]
struct Mip {
    mip: u8,
    width: u32,
    height: u32,
    /// Whether this row stands for the packed tail: this mip and all coarser ones.
    tail: bool,
    pages: u64,
    stored: u64,
    bytes: u64,
    /// Root mean square of reflectance that these pages add to the mip above.
    detail_rms: f64,
}

pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    if !is_archive(&arguments.input) {
        return btf::run(
            &arguments.input,
            &arguments.input_arguments.overrides(),
            arguments.json,
        );
    }
    let contents = read(&arguments.input)?;
    if arguments.json {
        return file::print_json(&contents);
    }
    Ok(std::io::stdout().lock().write_all(contents.text().as_bytes())?)
}

/// First bytes of every archive (docs/format.md).
const ARCHIVE_MAGIC: [u8; 8] = *b"\x89BSVTF\r\n";

/// By its name or its first bytes.
fn is_archive(path: &Path) -> bool {
    let mut first = [0; 8];
    let read = File::open(path).and_then(|mut file| file.read_exact(&mut first));
    path.extension().is_some_and(|extension| extension == "bsvtf") || (read.is_ok() && first == ARCHIVE_MAGIC)
}

/// Reads the manifest and directory of an archive.
pub(crate) fn read(path: &Path) -> Result<Contents> {
    let file = File::open(path).with_context(|| format!("cannot open {}", path.display()))?;
    let archive = Archive::open(file).with_context(|| path.display().to_string())?;
    let manifest_bytes = archive
        .prefix()
        .with_context(|| path.display().to_string())?
        .len() as u64;
    Ok(Contents::of(&archive.index, manifest_bytes))
}

impl Contents {
    fn of(index: &Index, manifest_bytes: u64) -> Self {
        let manifest = &index.manifest;
        let sum =
            |records: &[tileset::Record]| records.iter().map(|record| u64::from(record.length)).sum::<u64>();
        let largest =
            |records: &[tileset::Record]| records.iter().map(|record| record.length).max().unwrap_or(0);
        let stored = index.pages().iter().filter(|record| record.length > 0).count() as u64;
        let quantizer_step = manifest.codec.step();
        Self {
            name: manifest.name.clone(),
            generator: manifest.generator.clone(),
            id: format!("{:032x}", index.id),
            file_bytes: index.file_bytes,
            page_bytes: sum(index.pages()),
            column_bytes: sum(index.columns()),
            manifest_bytes,
            width: manifest.width,
            height: manifest.height,
            wrap: manifest.wrap,
            cosine: manifest.cosine,
            views: manifest.views.len(),
            lights: manifest.lights.len(),
            components: manifest.components,
            groups: manifest.groups(),
            factorization: manifest.factorization,
            codec: manifest.codec,
            quantizer_step,
            texture_scale: manifest.texture_scale,
            mean_rgb: manifest.mean_rgb,
            errors: Errors {
                stages: manifest.errors,
                total_rms: manifest.errors.total_rms(),
                total_relative: manifest.errors.total_relative(),
            },
            pages: Pages {
                count: index.pages().len() as u64,
                stored,
                largest_bytes: largest(index.pages()),
            },
            pages_by_mip: mips(index),
            columns: Columns {
                count: index.columns().len() as u64,
                largest_bytes: largest(index.columns()),
            },
            singular_values: manifest.singular_values.clone(),
        }
    }

    /// For people.
    fn text(&self) -> String {
        let share = |part: u64| {
            format!(
                "{:>10} {:5.1} %",
                bytes::text(part),
                100.0 * part as f64 / self.file_bytes as f64
            )
        };
        let Ledger {
            btf_rms,
            rank_rms,
            half_rms,
            codec_rms,
            measured_rms,
        } = self.errors.stages;
        let relative = |rms: f64| if btf_rms > 0.0 { 100.0 * rms / btf_rms } else { 0.0 };
        let mut text = format!(
            "{}, by {}\n  {} x {} texels{}, {} views x {} lights, {}\n  {} components in {} groups, quantizer step {}\n\n",
            self.name,
            self.generator,
            self.width,
            self.height,
            if self.wrap { ", repeating" } else { "" },
            self.views,
            self.lights,
            if self.cosine {
                "cosine included"
            } else {
                "cosine left out"
            },
            self.components,
            self.groups,
            self.quantizer_step,
        );
        text += &format!("bytes         {:>10}\n", bytes::text(self.file_bytes));
        for (name, part) in [
            ("pages", self.page_bytes),
            ("columns", self.column_bytes),
            ("manifest", self.manifest_bytes),
        ] {
            text += &format!("  {name:12}{}\n", share(part));
        }
        text += "\nerror (rms)   reflectance  of the BTF\n";
        for (name, rms) in [
            ("rank", rank_rms),
            ("half floats", half_rms),
            ("codec", codec_rms),
            ("all together", self.errors.total_rms),
            ("measured", measured_rms),
        ] {
            text += &format!("  {name:12}{rms:11.6} {:9.3} %\n", relative(rms));
        }
        text += "\nmip       texels   pages  stored       bytes  adds (rms)\n";
        for mip in &self.pages_by_mip {
            let size = format!("{}x{}{}", mip.width, mip.height, if mip.tail { "…" } else { "" });
            text += &format!(
                "{:3} {size:>12} {:7} {:7} {:>11} {:11.6}\n",
                mip.mip,
                mip.pages,
                mip.stored,
                bytes::text(mip.bytes),
                mip.detail_rms
            );
        }
        text
    }
}

fn mips(index: &Index) -> Vec<Mip> {
    let pyramid = &index.pyramid;
    let tiles: Vec<_> = pyramid.tiles().collect();
    let of = |mip: u8| {
        let (width, height) = pyramid.mip_size(mip);
        let records = index
            .pages()
            .chunks(tiles.len().max(1))
            .flat_map(|group| group.iter().zip(&tiles));
        let mut row = Mip {
            mip,
            width,
            height,
            tail: mip == pyramid.tail_mip(),
            pages: 0,
            stored: 0,
            bytes: 0,
            detail_rms: 0.0,
        };
        // Weights are mean squares over a page: shares of the mip's area turn them into one over the mip.
        let area = f64::from(width) * f64::from(height);
        for (record, tile) in records.filter(|(_, tile)| tile.mip == mip) {
            let (tile_width, tile_height) = pyramid.payload(*tile);
            row.pages += 1;
            row.stored += u64::from(record.length > 0);
            row.bytes += u64::from(record.length);
            row.detail_rms +=
                f64::from(record.weight) * f64::from(tile_width) * f64::from(tile_height) / area;
        }
        row.detail_rms = row.detail_rms.sqrt();
        row
    };
    (0..=pyramid.tail_mip()).map(of).collect()
}
