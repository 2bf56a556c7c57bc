//! One page with all that it shows inside.

use std::fmt::Write;

use image::{ExtendedColorType, ImageEncoder, codecs::png::PngEncoder};

use super::{Image, Origin, Part, Report};

const STYLE: &str = "body{font:15px/1.5 system-ui,sans-serif;max-width:1480px;margin:2em auto;padding:0 1em;color:#24292f;background:#fff}\
h1,h2{font-weight:500}.row{display:flex;flex-wrap:wrap;gap:14px}figure{margin:0;max-width:100%}img{max-width:100%;display:block}\
figcaption{font-size:13px;color:#57606a;max-width:420px}table{border-collapse:collapse;font-size:13px;font-variant-numeric:tabular-nums}\
td,th{padding:2px 9px;text-align:right;border-bottom:1px solid #d0d7de}td:first-child,th:first-child{text-align:left}\
svg{max-width:100%;height:auto}.scroll{overflow-x:auto}pre{overflow-x:auto;font-size:13px}footer{color:#57606a;font-size:13px;margin-top:2em}";

pub(super) fn page(report: &Report, origin: &Origin) -> String {
    let title = escape(&report.title);
    let mut page = format!(
        "<!doctype html><html lang=\"en\"><meta charset=\"utf-8\"><meta name=\"viewport\" content=\"width=device-width\">\
         <title>{title}</title><style>{STYLE}</style><h1>{title}</h1>\n"
    );
    for part in &report.parts {
        match part {
            Part::Heading(text) => page += &format!("<h2>{}</h2>\n", escape(text)),
            Part::Markdown(text) => page += &markdown(text),
            Part::Plots(plots) => page += &format!("<div class=\"row\">{}</div>\n", plots.concat()),
            Part::Figures(all) => {
                page += "<div class=\"row\">";
                for (images, caption) in all {
                    page += "<figure>";
                    for image in images {
                        let label = escape(&image.label);
                        page += &format!("<img alt=\"{label}\" src=\"{}\">", data_uri(image));
                    }
                    page += &format!("<figcaption>{}</figcaption></figure>", escape(caption));
                }
                page += "</div>\n";
            }
        }
    }
    page + &format!("<footer>{}</footer></html>\n", footer(origin))
}

fn footer(origin: &Origin) -> String {
    let mut text = format!("<pre>{}</pre>", escape(&origin.command));
    let on = [("on ", &origin.device), ("commit ", &origin.commit)];
    let known = on
        .into_iter()
        .filter_map(|(what, value)| Some(format!("{what}{}", escape(value.as_ref()?))));
    text += &known
        .chain([escape(&origin.machine.to_string())])
        .collect::<Vec<_>>()
        .join("; ");
    text
}

/// What the tables of this crate use of Markdown: paragraphs, tables, fenced blocks, and bold within cells.
fn markdown(text: &str) -> String {
    let mut html = String::new();
    let mut lines = text.lines().peekable();
    while let Some(&line) = lines.peek() {
        if line.starts_with('|') {
            let mut rows = Vec::new();
            while let Some(row) = lines.next_if(|line| line.starts_with('|')) {
                rows.push(row);
            }
            html += &table(&rows);
        } else if let Some(heading) = line.strip_prefix("### ") {
            lines.next();
            html += &format!("<h3>{}</h3>\n", escape(heading));
        } else if line.starts_with("```") {
            lines.next();
            html += "<pre>";
            while let Some(row) = lines.next_if(|line| !line.starts_with("```")) {
                html += &escape(row);
                html.push('\n');
            }
            lines.next();
            html += "</pre>\n";
        } else {
            let mut paragraph = Vec::new();
            let inside = |line: &&str| {
                !line.is_empty() && !["|", "```", "### "].iter().any(|mark| line.starts_with(mark))
            };
            while let Some(row) = lines.next_if(inside) {
                paragraph.push(escape(row));
            }
            if paragraph.is_empty() {
                lines.next();
            } else {
                html += &format!("<p>{}</p>\n", paragraph.join("\n"));
            }
        }
    }
    html
}

fn table(rows: &[&str]) -> String {
    let mut html = String::from("<div class=\"scroll\"><table>");
    for (row, line) in rows.iter().enumerate().filter(|(row, _)| *row != 1) {
        let cell = if row == 0 { "th" } else { "td" };
        html += "<tr>";
        let line = line.strip_prefix('|').unwrap_or(line);
        let line = line.strip_suffix('|').unwrap_or(line);
        for text in line.split('|') {
            let text = text.trim();
            let bold = text.strip_prefix("**").and_then(|text| text.strip_suffix("**"));
            let text = bold.map_or_else(|| escape(text), |text| format!("<b>{}</b>", escape(text)));
            let _ = write!(html, "<{cell}>{text}</{cell}>"); // strings take everything
        }
        html += "</tr>";
    }
    html + "</table></div>\n"
}

/// Text of XML and HTML.
pub(super) fn escape(text: &str) -> String {
    text.replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;")
        .replace('"', "&quot;")
}

/// A PNG that a page carries with it.
fn data_uri(image: &Image) -> String {
    let mut png = Vec::new();
    let (width, height) = image.size;
    match PngEncoder::new(&mut png).write_image(&image.rgb, width, height, ExtendedColorType::Rgb8) {
        Ok(()) => format!("data:image/png;base64,{}", base64(&png)),
        Err(_) => String::new(), // memory takes all that is written; sizes are those of pictures
    }
}

/// RFC 4648, section 4.
fn base64(bytes: &[u8]) -> String {
    const DIGITS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut text = String::with_capacity(bytes.len().div_ceil(3) * 4);
    for three in bytes.chunks(3) {
        let at = |index: usize| u32::from(three.get(index).copied().unwrap_or(0));
        let bits = at(0) << 16 | at(1) << 8 | at(2);
        for digit in 0..4 {
            let used = digit <= three.len();
            let value = (bits >> (18 - 6 * digit)) as usize & 63;
            text.push(if used { DIGITS[value].into() } else { '=' });
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    /// RFC 4648, section 10.
    #[test]
    fn base64_has_the_published_values() {
        for (bytes, text) in [
            ("", ""),
            ("f", "Zg=="),
            ("fo", "Zm8="),
            ("foo", "Zm9v"),
            ("foob", "Zm9vYg=="),
            ("fooba", "Zm9vYmE="),
            ("foobar", "Zm9vYmFy"),
        ] {
            assert_eq!(base64(bytes.as_bytes()), text);
        }
    }

    #[test]
    fn text_becomes_html() {
        let html = markdown(
            "### h\nbefore\n\n| a | b |\n|---|---:|\n| 1 < 2 | **x** |\n|  | y |\nafter\n```\n| a < b\n```\n",
        );
        assert_eq!(
            html,
            "<h3>h</h3>\n<p>before</p>\n<div class=\"scroll\"><table><tr><th>a</th><th>b</th></tr><tr><td>1 &lt; 2</td><td><b>x</b></td></tr>\
             <tr><td></td><td>y</td></tr></table></div>\n<p>after</p>\n<pre>| a &lt; b\n</pre>\n"
        );
    }

    #[test]
    fn a_page_is_complete_in_itself_and_says_where_it_is_from() {
        let image = Image {
            label: "\"red\"".into(),
            size: (1, 1),
            rgb: vec![255, 0, 0],
        };
        let report = Report::new("a & b")
            .heading("h")
            .plots(vec!["<svg/>".into()])
            .figures(vec![(vec![image], "<caption>".into())]);
        let origin = Origin {
            command: "eigentile bench <x>".into(),
            device: Some("software".into()),
            ..Origin::here(None)
        };
        let page = report.html(&origin);
        for part in [
            "<title>a &amp; b</title>",
            "<h2>h</h2>",
            "<svg/>",
            "alt=\"&quot;red&quot;\" src=\"data:image/png;base64,iVBOR",
            "&lt;caption&gt;",
            "eigentile bench &lt;x&gt;",
            "on software",
        ] {
            assert!(page.contains(part), "{part}: {page}");
        }
        assert!(!page.contains("<script") && page.ends_with("</html>\n"));
    }
}
