//! `eigentile`: synthesize, factorize, inspect, export, serve, render and view measured materials.
//!
//! Each command is one file; this one only chooses between them and says, in one line, what went wrong.

mod bench;
mod bytes;
mod cache;
mod convert;
mod demo;
mod export;
mod failure;
mod file;
mod input;
mod inspect;
mod preprocess;
mod progress;
mod render;
mod scene;
mod serve;
mod subject;
mod synth;
mod view;

use std::process::ExitCode;

use clap::{Parser, Subcommand};

/// Stream and render measured materials (BTFs) that are larger than memory.
#[derive(Parser)]
#[command(name = "eigentile", version, max_term_width = 110, after_help = EXAMPLES)]
struct Program {
    #[command(subcommand)]
    command: Command,
}

const EXAMPLES: &str = "\
From nothing to a picture:
  eigentile synth leather -o leather.npy --size 128
  eigentile preprocess leather.npy -o tiles/leather.bsvtf
  eigentile inspect tiles/leather.bsvtf
  eigentile serve tiles &
  eigentile render scene.gltf --tiles http://127.0.0.1:8080 -o pictures
  eigentile view tiles/leather.bsvtf

All of it at once, with a scene, a report and a page to look at:
  eigentile demo -o demo";

#[derive(Subcommand)]
enum Command {
    Synth(synth::Arguments),
    Preprocess(preprocess::Arguments),
    Inspect(inspect::Arguments),
    Convert(convert::Arguments),
    Export(export::Arguments),
    Serve(serve::Arguments),
    Render(render::Arguments),
    View(view::Arguments),
    Scene(scene::Arguments),
    Demo(demo::Arguments),
    Bench(bench::Arguments),
}

fn main() -> ExitCode {
    silence_display_probe();
    let program = match Program::try_parse() {
        Ok(program) => program,
        Err(error) => {
            // Help and version are no failures; what cannot be printed has no reader.
            let _ = error.print();
            return if error.use_stderr() {
                ExitCode::FAILURE
            } else {
                ExitCode::SUCCESS
            };
        }
    };
    let result = match program.command {
        Command::Synth(arguments) => synth::run(&arguments),
        Command::Preprocess(arguments) => preprocess::run(&arguments),
        Command::Inspect(arguments) => inspect::run(&arguments),
        Command::Convert(arguments) => convert::run(&arguments),
        Command::Export(arguments) => export::run(&arguments),
        Command::Serve(arguments) => serve::run(&arguments),
        Command::Render(arguments) => render::run(&arguments),
        Command::View(arguments) => view::run(&arguments),
        Command::Scene(arguments) => scene::run(&arguments),
        Command::Demo(arguments) => demo::run(&arguments),
        Command::Bench(arguments) => bench::run(&arguments),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) if failure::is_broken_pipe(&error) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {}", failure::one_line(&error));
            ExitCode::FAILURE
        }
    }
}

/// Mesa's device selection asks the Wayland compositor which graphics card is the default, and complains on
/// standard error where there is no session, as on a server. Without a session it is not asked.
fn silence_display_probe() {
    if std::env::var_os("XDG_RUNTIME_DIR").is_none() {
        // SAFETY: first thing in main, so no other thread reads the environment.
        unsafe { std::env::set_var("NODEVICE_SELECT", "1") };
    }
}
