//! The built page; `web/` holds its source, and `npm run build` there writes these files.

/// Media type and text of the file at a path below the page's own address.
pub(crate) fn find(path: &str) -> Option<(&'static str, &'static str)> {
    match path {
        "" => Some(("text/html; charset=utf-8", include_str!("../web/dist/index.html"))),
        "page.js" => Some(("text/javascript; charset=utf-8", include_str!("../web/dist/page.js"))),
        "page.css" => Some(("text/css; charset=utf-8", include_str!("../web/dist/page.css"))),
        _ => None,
    }
}
