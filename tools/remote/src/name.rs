//! Names of targets: `[user@]host` or a name of the user's ssh configuration, or `serve://HOST:PORT` of a listening
//! agent.

use std::fmt;
use std::str::FromStr;

/// Maximum length of a name in bytes.
const LONGEST: usize = 255;

/// Validated target, whose text is safe as the host argument of `ssh`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Target {
    /// Host known to `ssh`.
    Ssh(String),
    /// Address of a listening agent.
    Serve(String),
}

/// Invalid target.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum NoTarget {
    /// Name that `ssh` or a shell could misinterpret, or that is too long.
    #[error(
        "`{0}` is not a target: use [user@]host or a name of your ssh configuration, of letters, digits and ._@:[]- and not \
         beginning with -; or serve://HOST:PORT"
    )]
    Name(String),
    /// Address of a listening agent without a port.
    #[error(
        "`{0}` is not a target: it needs a port from 1 to 65535, such as serve://HOST:7000, and no user"
    )]
    Port(String),
}

impl FromStr for Target {
    type Err = NoTarget;

    fn from_str(text: &str) -> Result<Self, NoTarget> {
        let printable = || shared_types::text::printable(text).into_owned();
        let (host, is_served) = match text.strip_prefix("serve://") {
            Some(address) => (address, true),
            None => (text, false),
        };
        let is_legal = |c: char| c.is_ascii_alphanumeric() || "._@:[]-".contains(c);
        let is_short = (1..=LONGEST).contains(&host.len());
        if !is_short || host.starts_with('-') || !host.chars().all(is_legal) {
            return Err(NoTarget::Name(printable()));
        }
        if !is_served {
            return Ok(Self::Ssh(host.into()));
        }
        let port = host.rsplit_once(':').map(|(_, port)| port.parse::<u16>());
        match port {
            Some(Ok(port)) if port > 0 && !host.contains('@') => Ok(Self::Serve(host.into())),
            _ => Err(NoTarget::Port(printable())),
        }
    }
}

impl fmt::Display for Target {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Ssh(host) => f.write_str(host),
            Self::Serve(address) => write!(f, "serve://{address}"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hosts_and_addresses_are_targets() {
        for name in [
            "board",
            "me@board.local",
            "me@192.0.2.1",
            "a@[2001:db8::1]",
            "serve://board:7000",
        ] {
            assert_eq!(name.parse::<Target>().expect(name).to_string(), name);
        }
    }

    #[test]
    fn names_that_ssh_or_a_shell_could_misinterpret_are_refused() {
        let long = "a".repeat(LONGEST + 1);
        for name in [
            "",
            "-oProxyCommand=x",
            "a b",
            "a;b",
            "a$(b)",
            "a\nb",
            "a/b",
            "serve://",
            "serve://a",
            "serve://-a:1",
            "serve://a:0",
            "serve://a:99999",
            "ssh://a",
            &long,
        ] {
            assert!(name.parse::<Target>().is_err(), "{name}");
        }
        let without_port = "serve://a".parse::<Target>();
        assert_eq!(without_port, Err(NoTarget::Port("serve://a".into())));
    }
}
