//! Set-up, demo and tests of the whole workspace: `cargo xtask setup|demo|test|report|web|fuzz`.

mod browser;
mod fuzz;
mod setup;
mod steps;
mod web;

use std::path::Path;
use std::process::ExitCode;

use anyhow::{Context, Result, bail};
use steps::{Steps, cargo};

const HELP: &str = "\
Usage: cargo xtask COMMAND

  setup        make sure that a Vulkan adapter can be found, and what tests need: installs Mesa's software adapter, Chromium
               and the rest on Debian as root, says what to install elsewhere
  demo [ARGS]  set up, build, and run `eigentile demo ARGS`; with --serve the viewer can then be opened in a browser
  test         set up; formatting, clippy, all tests, documentation, the viewer in Chromium; warnings are errors
  report       write the tables and plots of docs/results.md from benches/results
  web          build the viewer for browsers: module, page and npm package, in web/dist
  fuzz [SECONDS]
               run every fuzz target for so long (60), with a C++ compiler; what they find is kept in target/fuzz

Examples:
  cargo xtask demo -o /tmp/demo
  cargo xtask demo --serve
  cargo xtask test";

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    match run(&arguments) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error:#}");
            ExitCode::FAILURE
        }
    }
}

fn run(arguments: &[String]) -> Result<()> {
    let mut steps = Steps::default();
    match arguments
        .split_first()
        .map(|(command, rest)| (command.as_str(), rest))
    {
        Some(("setup", [])) => {
            steps.run("setup", setup::setup)?;
            steps.run("browser setup", browser::setup)?;
        }
        Some(("demo", rest)) => {
            steps.run("setup", setup::setup)?;
            if let Err(error) = steps.run("web", web::build) {
                eprintln!("note: there will be no viewer for browsers: {error:#}");
            }
            let program = ["--release", "--package", "cli", "--bin", "eigentile"];
            steps.run("build", || cargo(&["build"]).args(program).run())?;
            steps.run("demo", || {
                cargo(&["run", "--quiet"])
                    .args(program)
                    .args(["--", "demo"])
                    .args(rest)
                    .run()
            })?;
        }
        Some(("test", [])) => {
            steps.run("setup", setup::setup)?;
            steps.run("browser setup", browser::setup)?;
            steps.run("fmt", || cargo(&["fmt", "--all", "--check"]).run())?;
            // Before anything that takes it in.
            steps.run("web", web::build)?;
            let lints = ["--workspace", "--all-targets", "--", "-D", "warnings"];
            steps.run("clippy", || cargo(&["clippy"]).args(lints).run())?;
            // Mesa's device selection otherwise complains on machines without a desktop session.
            steps.run("test", || {
                cargo(&["test", "--workspace"]).env("NODEVICE_SELECT", "1").run()
            })?;
            let documentation = ["--workspace", "--no-deps", "--document-private-items"];
            steps.run("doc", || {
                cargo(&["doc"])
                    .args(documentation)
                    .env("RUSTDOCFLAGS", "-D warnings")
                    .run()
            })?;
            steps.run("browser", browser::test)?;
        }
        Some(("report", [])) => {
            let root = Path::new(env!("CARGO_MANIFEST_DIR"))
                .parent()
                .context("xtask lies in the workspace")?;
            steps.run("report", || {
                cargo(&["run", "--quiet"])
                    .args(["--package", "cli", "--bin", "eigentile", "--", "bench", "tables"])
                    .args([root.join("docs/results.md").as_os_str(), "--results".as_ref()])
                    .args([root.join("benches/results")])
                    .run()
            })?;
        }
        Some(("web", [])) => steps.run("web", web::build)?,
        Some(("fuzz", rest @ ([] | [_]))) => {
            let seconds = match rest {
                [seconds] => seconds.parse().with_context(|| format!("seconds: {seconds:?}"))?,
                _ => 60,
            };
            steps.run("fuzz", || fuzz::fuzz(seconds))?;
        }
        Some(("-h" | "--help" | "help", _)) | None => println!("{HELP}"),
        Some((command, _)) => {
            bail!("no such command, or too many arguments: {command:?}; try `cargo xtask help`")
        }
    }
    steps.summary();
    Ok(())
}
