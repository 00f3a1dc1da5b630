//! A sheet as PDF: lines and areas as such, text in the font of the program, which the file
//! carries, pictures without loss.

use super::{Anchor, Item, POINT, Place, Sheet, colours, font};
use flate2::Compression;
use flate2::write::ZlibEncoder;
use image::RgbImage;
use pdf_writer::types::{
    CidFontType, FontFlags, LineCapStyle, LineJoinStyle, SystemInfo, UnicodeCmap,
};
use pdf_writer::{Content, Filter, Finish, Name, Pdf, Rect, Ref, Str, TextStr};
use std::io::Write;

const LETTERS: Name = Name(b"F1");
const POSTSCRIPT: Name = Name(b"Arimo");
const IDENTITY: Name = Name(b"Identity-H");
const UCS: SystemInfo =
    SystemInfo { registry: Str(b"Adobe"), ordering: Str(b"UCS"), supplement: 0 };
const CIDS: SystemInfo =
    SystemInfo { registry: Str(b"Adobe"), ordering: Str(b"Identity"), supplement: 0 };

/// The objects of the file before those of the pictures.
struct Objects {
    next: i32,
}

impl Objects {
    fn one(&mut self) -> Ref {
        self.next += 1;
        Ref::new(self.next)
    }
}

/// The drawing as a PDF file of one page.
pub fn file(sheet: &Sheet) -> anyhow::Result<Vec<u8>> {
    let scale = sheet.unit_mm / POINT;
    let [w, h] = sheet.size.map(|v| (v * scale) as f32);
    let mut objects = Objects { next: 0 };
    let [catalog, pages, page, content, info, letters] = std::array::from_fn(|_| objects.one());
    let mut pdf = Pdf::new();
    pdf.catalog(catalog).pages(pages);
    pdf.document_info(info).title(TextStr(&sheet.title)).creator(TextStr("dsfms"));
    pdf.pages(pages).kids([page]).count(1);
    let pictures: Vec<&RgbImage> = sheet
        .items
        .iter()
        .filter_map(|item| match item {
            Item::Picture { picture, .. } => Some(picture),
            _ => None,
        })
        .collect();
    let ids: Vec<Ref> = pictures.iter().map(|_| objects.one()).collect();
    for (&id, picture) in ids.iter().zip(&pictures) {
        write_picture(&mut pdf, id, picture)?;
    }
    write_font(&mut pdf, letters, &mut objects)?;
    let mut writer = pdf.page(page);
    writer.media_box(Rect::new(0.0, 0.0, w, h)).parent(pages).contents(content);
    let mut resources = writer.resources();
    resources.fonts().pair(LETTERS, letters);
    let mut named = resources.x_objects();
    for (k, id) in ids.iter().enumerate() {
        named.pair(Name(picture_name(k).as_bytes()), id);
    }
    named.finish();
    resources.finish();
    writer.finish();
    let drawn = packed(&drawing(sheet, scale))?;
    pdf.stream(content, &drawn).filter(Filter::FlateDecode);
    Ok(pdf.finish())
}

fn picture_name(k: usize) -> String {
    format!("P{k}")
}

fn packed(bytes: &[u8]) -> anyhow::Result<Vec<u8>> {
    let mut encoder = ZlibEncoder::new(Vec::new(), Compression::default());
    encoder.write_all(bytes)?;
    Ok(encoder.finish()?)
}

fn write_picture(pdf: &mut Pdf, id: Ref, picture: &RgbImage) -> anyhow::Result<()> {
    let bytes = packed(picture.as_raw())?;
    let mut image = pdf.image_xobject(id, &bytes);
    image.filter(Filter::FlateDecode);
    image.width(picture.width() as i32).height(picture.height() as i32);
    image.color_space().device_rgb();
    image.bits_per_component(8);
    image.finish();
    Ok(())
}

/// The whole font, with its widths and with the letter of every glyph, so that text can be searched
/// and copied.
fn write_font(pdf: &mut Pdf, id: Ref, objects: &mut Objects) -> anyhow::Result<()> {
    let [cid, descriptor, program, cmap] = std::array::from_fn(|_| objects.one());
    let face = &*font::FACE;
    pdf.type0_font(id)
        .base_font(POSTSCRIPT)
        .encoding_predefined(IDENTITY)
        .descendant_font(cid)
        .to_unicode(cmap);
    let mut glyphs = pdf.cid_font(cid);
    glyphs.subtype(CidFontType::Type2).base_font(POSTSCRIPT).system_info(CIDS);
    glyphs.font_descriptor(descriptor).cid_to_gid_map_predefined(Name(b"Identity"));
    let widths = (0..face.number_of_glyphs()).map(|g| font::advance(ttf_parser::GlyphId(g)) as f32);
    glyphs.widths().consecutive(0, widths);
    glyphs.finish();
    let thousandths = |v: i16| 1000.0 * f32::from(v) / f32::from(face.units_per_em());
    let b = face.global_bounding_box();
    let [x_min, y_min, x_max, y_max] = [b.x_min, b.y_min, b.x_max, b.y_max].map(thousandths);
    pdf.font_descriptor(descriptor)
        .name(POSTSCRIPT)
        .flags(FontFlags::NON_SYMBOLIC)
        .bbox(Rect::new(x_min, y_min, x_max, y_max))
        .italic_angle(0.0)
        .ascent(thousandths(face.ascender()))
        .descent(thousandths(face.descender()))
        .cap_height(thousandths(face.capital_height().unwrap_or(1409)))
        .stem_v(80.0)
        .font_file2(program);
    let length = font::FILE.len() as i32;
    let bytes = packed(font::FILE)?;
    pdf.stream(program, &bytes).filter(Filter::FlateDecode).pair(Name(b"Length1"), length);
    let mut map = UnicodeCmap::<u16>::new(Name(b"Arimo-UTF16"), UCS);
    for letter in (32..0x2300).filter_map(char::from_u32) {
        if let Some(glyph) = face.glyph_index(letter) {
            map.pair(glyph.0, letter);
        }
    }
    let letters = map.finish();
    pdf.cmap(cmap, &letters);
    Ok(())
}

/// What is drawn, in points from the lower left corner.
fn drawing(sheet: &Sheet, scale: f64) -> Vec<u8> {
    let mut content = Content::new();
    content.set_line_join(LineJoinStyle::RoundJoin).set_line_cap(LineCapStyle::ButtCap);
    let at = |p: Place| [(p[0] * scale) as f32, ((sheet.size[1] - p[1]) * scale) as f32];
    let mut picture = 0;
    for item in &sheet.items {
        match item {
            Item::Picture { at: [x, y], size, .. } => {
                let [w, h] = size.map(|v| (v * scale) as f32);
                let [x, y] = at([*x, y + size[1]]);
                content.save_state().transform([w, 0.0, 0.0, h, x, y]);
                content.x_object(Name(picture_name(picture).as_bytes())).restore_state();
                picture += 1;
            }
            Item::Text { at: p, anchor, size, upright, text } => {
                letter(&mut content, at(*p), (*anchor, *upright), size * scale, text);
            }
            Item::Line { points, width, dash, ink, .. } => {
                let [r, g, b] = unit(colours::of(*ink));
                content.set_stroke_rgb(r, g, b).set_line_width((width * scale) as f32);
                content.set_dash_pattern(dash.iter().map(|d| (d * scale) as f32), 0.0);
                through(&mut content, points.iter().map(|p| at(*p)));
                content.stroke();
            }
            Item::Area { points, ink } => {
                let [r, g, b] = unit(colours::of(*ink));
                content.set_fill_rgb(r, g, b);
                through(&mut content, points.iter().map(|p| at(*p)));
                content.fill_nonzero();
            }
            Item::Disc { at: p, radius, ink } => {
                let [r, g, b] = unit(colours::of(*ink));
                content.set_fill_rgb(r, g, b);
                circle(&mut content, at(*p), (radius * scale) as f32);
                content.fill_nonzero();
            }
        }
    }
    content.finish().to_vec()
}

fn unit(colour: [u8; 3]) -> [f32; 3] {
    colour.map(|c| f32::from(c) / 255.0)
}

fn through(content: &mut Content, points: impl Iterator<Item = [f32; 2]>) {
    for (k, [x, y]) in points.filter(|p| p.iter().all(|v| v.is_finite())).enumerate() {
        match k {
            0 => content.move_to(x, y),
            _ => content.line_to(x, y),
        };
    }
}

/// Four curves, whose handles are 0.5523 of the radius.
fn circle(content: &mut Content, [x, y]: [f32; 2], r: f32) {
    let k = 0.5523 * r;
    content.move_to(x + r, y);
    content.cubic_to(x + r, y + k, x + k, y + r, x, y + r);
    content.cubic_to(x - k, y + r, x - r, y + k, x - r, y);
    content.cubic_to(x - r, y - k, x - k, y - r, x, y - r);
    content.cubic_to(x + k, y - r, x + r, y - k, x + r, y);
    content.close_path();
}

fn letter(content: &mut Content, [x, y]: [f32; 2], how: (Anchor, bool), size: f64, text: &str) {
    let (anchor, upright) = how;
    let left = match anchor {
        Anchor::Start => 0.0,
        Anchor::Middle => -0.5 * font::width(text, size),
        Anchor::End => -font::width(text, size),
    } as f32;
    let matrix = match upright {
        false => [1.0, 0.0, 0.0, 1.0, x + left, y],
        true => [0.0, 1.0, -1.0, 0.0, x, y + left],
    };
    let glyphs: Vec<u8> = text.chars().flat_map(|c| font::glyph(c).0.to_be_bytes()).collect();
    let [r, g, b] = unit(colours::INK);
    content.set_fill_rgb(r, g, b);
    content.begin_text().set_font(LETTERS, size as f32).set_text_matrix(matrix);
    content.show(Str(&glyphs)).end_text();
}

#[cfg(test)]
mod tests {
    use super::super::Ink;
    use super::*;

    #[test]
    fn a_page_has_its_size_and_font_and_pictures() {
        let mut sheet = Sheet::in_pixels(96, 48);
        sheet.put([0, 0], RgbImage::from_pixel(4, 4, image::Rgb([200, 10, 20])));
        sheet.write([5.0, 20.0], Anchor::Start, 10.0, "error (mm) ≥ 5");
        sheet.items.push(Item::line(vec![[0.0, 0.0], [9.0, f64::NAN]], 1.0, Ink::Text));
        let bytes = file(&sheet).unwrap();
        let text = String::from_utf8_lossy(&bytes);
        for word in
            ["%PDF-1.7", "/MediaBox [0 0 72 36]", "/FontFile2", "/Identity-H", "/Width 4", "%%EOF"]
        {
            assert!(text.contains(word), "{word}");
        }
    }
}
