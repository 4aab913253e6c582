//! PDF of a scene: one page of its size, with its font.
//!
//! Has no date and no number of chance, so that the same scene gives the same bytes.

use std::collections::BTreeMap;

use miniz_oxide::deflate::compress_to_vec_zlib;
use pdf_writer::types::{CidFontType, FontFlags, SystemInfo, UnicodeCmap};
use pdf_writer::{Content, Filter, Finish, Name, Pdf, Rect, Ref, Str, TextStr};

use super::font::{FILE, Font, NAME};
use super::scene::{Item, Line, Scene, Text};

/// Level of compression.
const LEVEL: u8 = 6;
/// Name of the font in the file; a prefix of six letters stands for a reduced font.
const SUBSET: &str = "HILFIG+Arimo";
/// Character set of glyph numbers.
const IDENTITY: SystemInfo<'static> = SystemInfo {
    registry: Str(b"Adobe"),
    ordering: Str(b"Identity"),
    supplement: 0,
};

/// Formats a figure as a file.
pub(super) fn file(scene: &Scene) -> Vec<u8> {
    let numbers: [Ref; 10] = std::array::from_fn(|at| Ref::new(at as i32 + 1));
    let [
        catalog,
        tree,
        page_id,
        content_id,
        info,
        font_id,
        cid_id,
        descriptor,
        font_file,
        cmap_id,
    ] = numbers;
    let font = Font::new();
    let mut pdf = Pdf::new();
    pdf.catalog(catalog).pages(tree);
    pdf.pages(tree).kids([page_id]).count(1);
    pdf.document_info(info)
        .title(TextStr(&scene.title))
        .producer(TextStr("hil"));
    let [width, height] = scene.size;
    let mut page = pdf.page(page_id);
    page.parent(tree)
        .media_box(Rect::new(0.0, 0.0, number(width), number(height)))
        .contents(content_id);
    page.resources()
        .fonts()
        .pair(Name(NAME.as_bytes()), font_id);
    page.finish();
    let content = compress_to_vec_zlib(&content(scene, &font), LEVEL);
    pdf.stream(content_id, &content).filter(Filter::FlateDecode);

    pdf.type0_font(font_id)
        .base_font(Name(SUBSET.as_bytes()))
        .encoding_predefined(Name(b"Identity-H"))
        .descendant_font(cid_id)
        .to_unicode(cmap_id);
    let glyphs = glyphs(scene, &font);
    let mut cid = pdf.cid_font(cid_id);
    cid.subtype(CidFontType::Type2)
        .base_font(Name(SUBSET.as_bytes()))
        .system_info(IDENTITY)
        .font_descriptor(descriptor)
        .cid_to_gid_map_predefined(Name(b"Identity"))
        .default_width(0.0);
    let mut widths = cid.widths();
    for glyph in glyphs.keys() {
        widths.consecutive(*glyph, [font.advance(*glyph) as f32]);
    }
    widths.finish();
    cid.finish();
    let [ascent, descent, capitals] = font.heights();
    let [left, bottom, right, top] = font.bounds().map(|edge| edge as f32);
    pdf.font_descriptor(descriptor)
        .name(Name(SUBSET.as_bytes()))
        .flags(FontFlags::NON_SYMBOLIC)
        .bbox(Rect::new(left, bottom, right, top))
        .italic_angle(0.0)
        .ascent(ascent as f32)
        .descent(descent as f32)
        .cap_height(capitals as f32)
        .stem_v(80.0)
        .font_file2(font_file);
    let compressed = compress_to_vec_zlib(FILE, LEVEL);
    pdf.stream(font_file, &compressed)
        .filter(Filter::FlateDecode)
        .pair(Name(b"Length1"), FILE.len() as i32);
    let mut cmap = UnicodeCmap::new(Name(b"Custom"), IDENTITY);
    for (glyph, character) in &glyphs {
        cmap.pair(*glyph, *character);
    }
    pdf.cmap(cmap_id, &cmap.finish());
    pdf.finish()
}

/// Returns the glyphs of all texts, each with its character.
fn glyphs(scene: &Scene, font: &Font) -> BTreeMap<u16, char> {
    let characters = scene.texts().flat_map(|text| text.text.chars());
    characters.map(|one| (font.glyph(one), one)).collect()
}

fn content(scene: &Scene, font: &Font) -> Vec<u8> {
    let height = scene.size[1];
    let mut content = Content::new();
    content.set_line_join(pdf_writer::types::LineJoinStyle::RoundJoin);
    for item in &scene.items {
        match item {
            Item::Line(line) => write_line(&mut content, line, scene),
            Item::Text(text) => write_text(&mut content, text, font, height),
        }
    }
    content.finish().to_vec()
}

fn write_line(content: &mut Content, line: &Line, scene: &Scene) {
    let flipped = |y: f64| number(scene.size[1] - y);
    let stroke = line.stroke;
    content.save_state();
    if let Some(panel) = line.clip.and_then(|panel| scene.panels.get(panel)) {
        let (width, height) = (panel.right - panel.left, panel.bottom - panel.top);
        content
            .rect(
                number(panel.left),
                flipped(panel.bottom),
                number(width),
                number(height),
            )
            .clip_nonzero()
            .end_path();
    }
    let [red, green, blue] = stroke.colour.map(|part| f32::from(part) / 255.0);
    content
        .set_stroke_rgb(red, green, blue)
        .set_line_width(number(stroke.width))
        .set_dash_pattern(stroke.dash.iter().map(|one| number(*one)), 0.0);
    for part in &line.parts {
        for (place, [x, y]) in part.iter().enumerate() {
            let (x, y) = (number(*x), flipped(*y));
            match place {
                0 => content.move_to(x, y),
                _ => content.line_to(x, y),
            };
        }
    }
    content.stroke().restore_state();
}

fn write_text(content: &mut Content, text: &Text, font: &Font, height: f64) {
    let [x, y] = text.start(font);
    let (x, y) = (number(x), number(height - y));
    let turn = match text.is_upright {
        true => [0.0, 1.0, -1.0, 0.0, x, y],
        false => [1.0, 0.0, 0.0, 1.0, x, y],
    };
    let characters = text.text.chars();
    let bytes: Vec<u8> = characters
        .flat_map(|one| font.glyph(one).to_be_bytes())
        .collect();
    content
        .begin_text()
        .set_font(Name(NAME.as_bytes()), number(text.size))
        .set_text_matrix(turn)
        .show(Str(&bytes))
        .end_text();
}

/// Rounds a length in points to two decimals, which is finer than any printer.
fn number(value: f64) -> f32 {
    (libm::round(100.0 * value) / 100.0) as f32
}
