//! A sheet as SVG: on paper with colours, sizes and widths; on a page with classes for its style
//! sheet.

use super::{Anchor, Ink, Item, Place, Sheet, colours, font};
use crate::outputs::encode_png;
use crate::report::embed::{base64, escape};

/// The drawing as a file of its own; pictures inside it as PNG.
pub fn paper(sheet: &Sheet) -> anyhow::Result<String> {
    let [w, h] = sheet.size;
    let [wide, high] = sheet.size.map(|v| v * sheet.unit_mm);
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{wide:.2}mm\" height=\"{high:.2}mm\" \
         viewBox=\"0 0 {w:.2} {h:.2}\" role=\"img\" font-family=\"{}\">\n<title>{}</title>\
         <rect width=\"{w:.2}\" height=\"{h:.2}\" fill=\"#fff\"/>\n",
        font::FAMILY,
        escape(&sheet.title)
    );
    for item in &sheet.items {
        svg += &match item {
            Item::Picture { at: [x, y], size: [w, h], picture } => {
                let data = base64(&encode_png(picture)?);
                format!(
                    "<image x=\"{x:.2}\" y=\"{y:.2}\" width=\"{w:.2}\" height=\"{h:.2}\" \
                     preserveAspectRatio=\"none\" href=\"data:image/png;base64,{data}\"/>\n"
                )
            }
            item => vector(item, &|item| style(item)) + "\n",
        };
    }
    Ok(svg + "</svg>\n")
}

/// The items of a chart inside the `svg` of a page: no pictures, no sizes of text.
pub fn page(items: &[Item]) -> String {
    items.iter().map(|item| vector(item, &class)).collect()
}

/// An item without pixels; `looks` are its attributes of colour and size.
fn vector(item: &Item, looks: &dyn Fn(&Item) -> String) -> String {
    let looks = looks(item);
    match item {
        Item::Picture { .. } => String::new(),
        Item::Text { at: [x, y], anchor, upright, text, .. } => {
            let anchor = match anchor {
                Anchor::Start => "",
                Anchor::Middle => " text-anchor=\"middle\"",
                Anchor::End => " text-anchor=\"end\"",
            };
            let place = match upright {
                false => format!("x=\"{x:.1}\" y=\"{y:.1}\""),
                true => format!("transform=\"translate({x:.1} {y:.1}) rotate(-90)\""),
            };
            format!("<text {place}{anchor}{looks}>{}</text>", escape(text))
        }
        Item::Line { points, said, .. } => {
            format!("<polyline points=\"{}\"{looks}{said}/>", places(points))
        }
        Item::Area { points, .. } => format!("<polygon points=\"{}\"{looks}/>", places(points)),
        Item::Disc { at: [x, y], radius, .. } => {
            format!("<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"{radius:.1}\"{looks}/>")
        }
    }
}

fn places(points: &[Place]) -> String {
    points.iter().map(|[x, y]| format!("{x:.1},{y:.1}")).collect::<Vec<_>>().join(" ")
}

fn style(item: &Item) -> String {
    match item {
        Item::Text { size, .. } => format!(" font-size=\"{size:.1}\" fill=\"{}\"", hex(Ink::Text)),
        Item::Line { width, dash, ink, .. } => {
            let dash = match dash {
                [] => String::new(),
                all => {
                    let all: Vec<String> = all.iter().map(f64::to_string).collect();
                    format!(" stroke-dasharray=\"{}\"", all.join(" "))
                }
            };
            format!(" fill=\"none\" stroke=\"{}\" stroke-width=\"{width}\"{dash}", hex(*ink))
        }
        Item::Area { ink, .. } | Item::Disc { ink, .. } => format!(" fill=\"{}\"", hex(*ink)),
        Item::Picture { .. } => String::new(),
    }
}

fn class(item: &Item) -> String {
    let name = match item {
        Item::Text { .. } | Item::Picture { .. } => return String::new(),
        Item::Line { ink, .. } | Item::Area { ink, .. } | Item::Disc { ink, .. } => match ink {
            Ink::Text => "axis".into(),
            Ink::Grid => "grid-line".into(),
            Ink::Line(k) => format!("line s{}", k % 6),
            Ink::Marker(k) => format!("marker s{}", k % 6),
            Ink::Whisker(k) => format!("whisker s{}", k % 6),
            Ink::Bar(false) => "bar".into(),
            Ink::Bar(true) => "bar strong".into(),
            Ink::Status(status) => format!("status {status}"),
            Ink::Rgb(_) => return style(item),
        },
    };
    format!(" class=\"{name}\"")
}

fn hex(ink: Ink) -> String {
    let [r, g, b] = colours::of(ink);
    format!("#{r:02x}{g:02x}{b:02x}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn markup_in_a_label_stays_text() {
        let items = vec![Item::text([100.0, 20.0], Anchor::Middle, 12.0, "<&>")];
        let sheet = Sheet { size: [200.0, 32.0], unit_mm: 1.0, title: "<u>".into(), items };
        let svg = paper(&sheet).unwrap();
        assert!(svg.contains("&lt;&amp;&gt;</text>") && svg.contains("<title>&lt;u&gt;"), "{svg}");
        assert!(page(&sheet.items).contains("&lt;&amp;&gt;</text>"));
    }
}
