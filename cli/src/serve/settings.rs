//! What the server can be told, by flags, by the environment and by a file: each wins over the ones behind it.

use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::str::FromStr;
use std::time::Duration;

use anyhow::{Context, Result};
use clap::Args;
use serde::Deserialize;
use tileserver::Options;

use crate::bytes;

/// The configuration file: all settings under the names of their flags, and more collections.
#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct File {
    /// As the positional argument.
    pub(crate) source: Option<String>,
    /// Served beside it, at `/PLACE/v1/`.
    #[serde(default, rename = "collection")]
    pub(crate) collections: Vec<Further>,
    /// The other settings.
    #[serde(default)]
    pub(crate) settings: Settings,
}

/// A further collection.
#[derive(Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub(crate) struct Further {
    /// First segment of its addresses.
    pub(crate) place: String,
    /// Folder or URL.
    pub(crate) source: String,
    /// Who may read it; all if there is none.
    pub(crate) token_file: Option<PathBuf>,
}

impl File {
    /// Reads a TOML file.
    pub(crate) fn read(path: &Path) -> Result<Self> {
        let text =
            std::fs::read_to_string(path).with_context(|| format!("cannot read {}", path.display()))?;
        toml::from_str(&text).with_context(|| format!("{} does not hold settings", path.display()))
    }
}

/// A number of bytes, such as `256MiB`; 0 is one, too.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(try_from = "String")]
pub(crate) struct Size(u64);

impl FromStr for Size {
    type Err = String;
    fn from_str(text: &str) -> Result<Self, String> {
        if text.trim() == "0" {
            return Ok(Self(0));
        }
        bytes::parse(text).map(Self)
    }
}

impl TryFrom<String> for Size {
    type Error = String;
    fn try_from(text: String) -> Result<Self, String> {
        text.parse()
    }
}

/// Seconds, with a fraction if need be.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(try_from = "f64")]
pub(crate) struct Seconds(Duration);

impl TryFrom<f64> for Seconds {
    type Error = String;
    fn try_from(seconds: f64) -> Result<Self, String> {
        // A year: time beyond what the clock can count would be a panic.
        let bounded = (0.0..=3.2e7).contains(&seconds);
        let duration = bounded.then(|| Duration::from_secs_f64(seconds));
        duration
            .map(Self)
            .ok_or_else(|| format!("{seconds} is not between 0 and 32000000 seconds"))
    }
}

impl FromStr for Seconds {
    type Err = String;
    fn from_str(text: &str) -> Result<Self, String> {
        let seconds: f64 = text
            .parse()
            .map_err(|_| format!("{text:?} is no number of seconds"))?;
        seconds.try_into()
    }
}

/// Defines the settings once, for flags, environment and file.
macro_rules! settings {
    ($($(#[doc = $doc:literal])+ $name:ident: $kind:ty, $env:literal, $value:literal;)+) => {
        /// Settings that may stand in a file as well as on the command line.
        #[derive(Args, Clone, Debug, Default, PartialEq, Deserialize)]
        #[serde(deny_unknown_fields, rename_all = "kebab-case", default)]
        pub(crate) struct Settings {
            $($(#[doc = $doc])+ #[arg(long, env = $env, value_name = $value)] pub(crate) $name: Option<$kind>,)+
        }

        impl Settings {
            /// These, and where they say nothing, others.
            pub(crate) fn or(self, other: Self) -> Self {
                Self { $($name: self.$name.or(other.$name),)+ }
            }
        }
    };
}

settings! {
    /// Address and port; port 0 takes a free one and prints it [default: 127.0.0.1:8080]
    listen: SocketAddr, "EIGENTILE_LISTEN", "ADDRESS";
    /// Certificate chain (PEM): serve HTTPS only; read again when it changes
    tls_certificate: PathBuf, "EIGENTILE_TLS_CERTIFICATE", "FILE";
    /// Key of the certificate (PEM)
    tls_key: PathBuf, "EIGENTILE_TLS_KEY", "FILE";
    /// Bearer tokens, one a line: answer only those who send one of them
    token_file: PathBuf, "EIGENTILE_TOKEN_FILE", "FILE";
    /// Folder of a web page, served at / beside the archives [default: the viewer, where it is built in]
    site: PathBuf, "EIGENTILE_SITE", "DIR";
    /// Connections at the same time; more wait [default: 16384]
    connections: usize, "EIGENTILE_CONNECTIONS", "N";
    /// Requests at the same time; more get 503 at once [default: 2048]
    requests: usize, "EIGENTILE_REQUESTS", "N";
    /// Requests at the same time on one connection of HTTP/2 [default: 128]
    streams: u32, "EIGENTILE_STREAMS", "N";
    /// Memory of answers that are not sent yet [default: 256MiB]
    memory: Size, "EIGENTILE_MEMORY", "SIZE";
    /// Memory for records that were asked for lately; 0 for none [default: 256MiB]
    cache: Size, "EIGENTILE_CACHE", "SIZE";
    /// Reads from the store at the same time [default: 16]
    reads: usize, "EIGENTILE_READS", "N";
    /// How long the list of archives is taken to be right [default: 1]
    list_age: Seconds, "EIGENTILE_LIST_AGE", "SECONDS";
    /// For the head of a request, and for a TLS handshake [default: 10]
    header_timeout: Seconds, "EIGENTILE_HEADER_TIMEOUT", "SECONDS";
    /// Until an answer begins; then 503 [default: 30]
    request_timeout: Seconds, "EIGENTILE_REQUEST_TIMEOUT", "SECONDS";
    /// For one read from the store; three are tried [default: 8]
    store_timeout: Seconds, "EIGENTILE_STORE_TIMEOUT", "SECONDS";
    /// Longest silence on a connection [default: 60]
    idle_timeout: Seconds, "EIGENTILE_IDLE_TIMEOUT", "SECONDS";
    /// How long /ready says no before connections are refused, once told to stop [default: 0]
    notice: Seconds, "EIGENTILE_NOTICE", "SECONDS";
    /// How long requests in progress may go on after that [default: 10]
    drain_timeout: Seconds, "EIGENTILE_DRAIN_TIMEOUT", "SECONDS";
}

impl Settings {
    /// The limits, with the server's own defaults.
    pub(crate) fn options(&self) -> Options {
        let default = Options::default();
        let time = |seconds: Option<Seconds>, default| seconds.map_or(default, |seconds| seconds.0);
        Options {
            connections: self.connections.unwrap_or(default.connections),
            requests: self.requests.unwrap_or(default.requests),
            streams: self.streams.unwrap_or(default.streams),
            memory_bytes: self.memory.map_or(default.memory_bytes, |size| size.0),
            cache_bytes: self.cache.map_or(default.cache_bytes, |size| size.0),
            reads: self.reads.unwrap_or(default.reads),
            list_age: time(self.list_age, default.list_age),
            header_timeout: time(self.header_timeout, default.header_timeout),
            request_timeout: time(self.request_timeout, default.request_timeout),
            store_timeout: time(self.store_timeout, default.store_timeout),
            idle_timeout: time(self.idle_timeout, default.idle_timeout),
            notice: time(self.notice, default.notice),
            drain_timeout: time(self.drain_timeout, default.drain_timeout),
        }
    }
}

/// Tokens of a file, one a line; empty lines and those that begin with # do not count.
pub(crate) fn tokens(path: &Path) -> Result<Vec<String>> {
    let text = std::fs::read_to_string(path).with_context(|| format!("cannot read {}", path.display()))?;
    let lines = text
        .lines()
        .map(str::trim)
        .filter(|line| !line.is_empty() && !line.starts_with('#'));
    let tokens: Vec<_> = lines.map(str::to_owned).collect();
    // Without a token all would be let in, which is not what a file of tokens is for.
    anyhow::ensure!(
        !tokens.is_empty(),
        "{} has no token: write one a line",
        path.display()
    );
    Ok(tokens)
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = r#"
        source = "tiles"
        [settings]
        listen = "0.0.0.0:80"
        cache = "0"
        idle-timeout = 5
        notice = 0.5
        [[collection]]
        place = "museum"
        source = "s3://bucket/museum"
        token-file = "museum.tokens"
    "#;

    #[test]
    fn files_are_read_and_flags_win() {
        let file: File = toml::from_str(TEXT).unwrap();
        assert_eq!(
            (file.collections.len(), file.source.as_deref()),
            (1, Some("tiles"))
        );
        let flags = Settings {
            idle_timeout: Some("7".parse().unwrap()),
            ..Settings::default()
        };
        let options = flags.or(file.settings).options();
        assert_eq!(options.idle_timeout, Duration::from_secs(7));
        assert_eq!(
            (options.notice, options.cache_bytes),
            (Duration::from_millis(500), 0)
        );
        assert_eq!(options.requests, Options::default().requests);
        assert_eq!(Settings::default().options(), Options::default());
    }

    #[test]
    fn what_is_not_understood_is_refused() {
        for text in [
            "sauce = 1",
            "[settings]\nlisten_to = 1",
            "[settings]\nlisten = \"here\"",
            "[settings]\ncache = \"much\"",
            "[settings]\nnotice = -1",
            "[settings]\nnotice = nan",
            "[[collection]]\nplace = \"x\"",
        ] {
            assert!(toml::from_str::<File>(text).is_err(), "{text}");
        }
    }

    #[test]
    fn a_file_of_tokens_has_one() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("tokens");
        std::fs::write(&path, "# for the museum\n\n first \nsecond\n").unwrap();
        assert_eq!(tokens(&path).unwrap(), ["first", "second"]);
        std::fs::write(&path, "# none\n").unwrap();
        assert!(tokens(&path).unwrap_err().to_string().contains("no token"));
    }
}
