//! Addresses of records on a tile server.

use hyper::Uri;

use super::super::{Request, escape::escape};
use crate::{Error, Result};

/// Where a tile server is.
pub(in crate::stream) struct Address {
    /// `http[s]://HOST[:PORT][/PREFIX]`, without a slash at the end.
    base: String,
    /// What stands behind the `?`.
    query: Option<String>,
}

impl Address {
    pub(in crate::stream) fn parse(typed: &str) -> Result<Self> {
        let refuse = |detail: &str| Error::Source {
            what: format!("address {typed:?}"),
            detail: format!("{detail}: give http://HOST:PORT or https://HOST"),
        };
        let uri: Uri = typed
            .trim()
            .parse()
            .map_err(|error| refuse(&format!("no URL ({error})")))?;
        let scheme = uri
            .scheme_str()
            .filter(|scheme| matches!(*scheme, "http" | "https"));
        let scheme = scheme.ok_or_else(|| refuse("only http:// and https:// are supported"))?;
        let authority = uri.authority().filter(|authority| !authority.host().is_empty());
        let authority = authority.ok_or_else(|| refuse("no host"))?;
        if authority.as_str().contains('@') {
            return Err(refuse("user names are not supported"));
        }
        Ok(Self {
            base: format!("{scheme}://{authority}{}", uri.path().trim_end_matches('/')),
            query: uri.query().map(str::to_owned),
        })
    }

    /// What stands behind the `?` of the address, as a presigned one has it.
    pub(in crate::stream) fn query(&self) -> Option<&str> {
        self.query.as_deref()
    }

    /// # Errors
    /// [`Error::Source`] for an address with a query: a tile server has none.
    pub(super) fn without_query(self) -> Result<Self> {
        match self.query {
            None => Ok(self),
            Some(_) => Err(Error::Source {
                what: format!("address {:?}", self.base),
                detail: "tile servers take no query: leave out what stands behind the question mark".into(),
            }),
        }
    }

    /// As it was given, without a slash at the end, and without query.
    pub(in crate::stream) fn base(&self) -> &str {
        &self.base
    }

    /// Address of the index of an archive as it is now.
    pub(super) fn index(&self, archive: &str) -> String {
        format!("{}/v1/{}/index", self.base, escape(archive))
    }

    pub(super) fn manifest(&self, archive: &str) -> String {
        format!("{}/v1/{}", self.base, escape(archive))
    }

    /// Address of many records in one answer.
    pub(in crate::stream) fn batch(&self, archive: &str, id: &str, list: &str) -> String {
        format!("{}/v1/{}/{id}/batch/{list}", self.base, escape(archive))
    }

    /// Address of what is asked for, in the archive with this content id.
    pub(super) fn record(&self, request: &Request, id: &str) -> String {
        let archive = format!("{}/v1/{}/{id}", self.base, escape(request.archive()));
        match request {
            Request::Index { .. } => format!("{archive}/index"),
            Request::Page { page, .. } => {
                let tileset::Tile { mip, x, y } = page.tile;
                format!("{archive}/page/{}/{mip}/{x}/{y}", page.group)
            }
            Request::Column { group, .. } => format!("{archive}/column/{group}"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses() {
        let address = Address::parse("http://host:8080/tiles/").unwrap();
        assert_eq!(
            address.manifest("wool 2/é"),
            "http://host:8080/tiles/v1/wool%202%2F%C3%A9"
        );
        assert_eq!(address.manifest(".."), "http://host:8080/tiles/v1/%2E%2E");
        let tile = tileset::Tile { mip: 2, x: 3, y: 4 };
        let request = Request::Page {
            archive: "a".into(),
            page: tileset::PageId { group: 1, tile },
        };
        assert_eq!(
            address.record(&request, "0f"),
            "http://host:8080/tiles/v1/a/0f/page/1/2/3/4"
        );
    }

    #[test]
    fn what_is_no_address() {
        for bad in [
            "",
            "http://",
            "host",
            "ftp://host",
            "http://user:secret@host",
            "http://a b",
        ] {
            assert!(Address::parse(bad).is_err(), "{bad}");
        }
        let signed = Address::parse("HTTPS://host/a.bsvtf?sig=a%2Fb").unwrap();
        assert_eq!(
            (signed.base(), signed.query()),
            ("https://host/a.bsvtf", Some("sig=a%2Fb"))
        );
        assert!(signed.without_query().is_err());
    }
}
