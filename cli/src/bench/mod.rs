//! `eigentile bench`: what is promised, measured. One subcommand, one file.
//!
//! To add one: its file with `Arguments` and `run`, and a line in `Subject` and in `run`. The work itself lives in the
//! crate `benches`.

mod all;
mod codec;
mod compare;
mod decode;
mod endurance;
mod engine;
mod factorize;
mod memory_quality;
mod output;
mod policy;
mod range;
mod replay;
mod scale;
mod serve;
mod stability;
mod stream;
mod tables;
mod time_error;
mod viewed;

use anyhow::Result;
use clap::{Args, Subcommand};

/// Measure bytes, errors and speed, to compare with other programs.
#[derive(Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Arguments {
    #[command(subcommand)]
    subject: Subject,
}

const EXAMPLES: &str = "\
Examples:
  eigentile bench all --quick
  eigentile bench codec leather.npy --keep kept
  eigentile bench compare before.json after.json
  eigentile bench decode kept/leather/*.bsvtf
  eigentile bench endurance
  eigentile bench engine
  eigentile bench factorize leather.npy --json
  eigentile bench memory-quality --report memory.html
  eigentile bench policy
  eigentile bench range leather.npy
  eigentile bench replay flight.json --record
  eigentile bench scale
  eigentile bench serve cloth.bsvtf
  eigentile bench stability
  eigentile bench stream
  eigentile bench time-error --report time.html

benches/peers in the source tree has the programs to measure beside, and scripts that run both.";

#[derive(Subcommand)]
enum Subject {
    All(all::Arguments),
    Codec(codec::Arguments),
    Compare(compare::Arguments),
    Decode(decode::Arguments),
    Endurance(endurance::Arguments),
    Engine(engine::Arguments),
    Factorize(factorize::Arguments),
    MemoryQuality(memory_quality::Arguments),
    Policy(policy::Arguments),
    Range(range::Arguments),
    Replay(replay::Arguments),
    Scale(scale::Arguments),
    Serve(serve::Arguments),
    Stability(stability::Arguments),
    Stream(stream::Arguments),
    Tables(tables::Arguments),
    TimeError(time_error::Arguments),
}

pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    match &arguments.subject {
        Subject::All(arguments) => all::run(arguments),
        Subject::Codec(arguments) => codec::run(arguments),
        Subject::Compare(arguments) => compare::run(arguments),
        Subject::Decode(arguments) => decode::run(arguments),
        Subject::Endurance(arguments) => endurance::run(arguments),
        Subject::Engine(arguments) => engine::run(arguments),
        Subject::Factorize(arguments) => factorize::run(arguments),
        Subject::MemoryQuality(arguments) => memory_quality::run(arguments),
        Subject::Policy(arguments) => policy::run(arguments),
        Subject::Range(arguments) => range::run(arguments),
        Subject::Replay(arguments) => replay::run(arguments),
        Subject::Scale(arguments) => scale::run(arguments),
        Subject::Serve(arguments) => serve::run(arguments),
        Subject::Stability(arguments) => stability::run(arguments),
        Subject::Stream(arguments) => stream::run(arguments),
        Subject::Tables(arguments) => tables::run(arguments),
        Subject::TimeError(arguments) => time_error::run(arguments),
    }
}
