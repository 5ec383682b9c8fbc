//! The built page; `web/` holds its source, and `npm run build` there writes these files.

/// One file of the page.
#[derive(Debug)]
pub(crate) struct Asset {
    pub(crate) media_type: &'static str,
    pub(crate) bytes: &'static [u8],
}

/// The file of a path below the page's own address.
pub(crate) fn find(path: &str) -> Option<Asset> {
    let (media_type, bytes): (_, &'static [u8]) = match path {
        "" => ("text/html; charset=utf-8", include_bytes!("../web/dist/index.html")),
        "page.js" => ("text/javascript; charset=utf-8", include_bytes!("../web/dist/page.js")),
        "page.css" => ("text/css; charset=utf-8", include_bytes!("../web/dist/page.css")),
        _ => return None,
    };
    Some(Asset { media_type, bytes })
}
