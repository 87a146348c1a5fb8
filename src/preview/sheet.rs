//! The contact sheet: a tile for the rendered frame and one for each combination of settings, with words, as PNG.

use std::path::Path;

use resvg::tiny_skia::{Color, Pixmap, PixmapPaint, Transform};

use super::flicker::{Flicker, MOST_CHANGE};
use super::images::{LayerPreview, Preview, Variant};
use super::tile::{NOWHERE, Scale, change, light};
use super::wipe::{line, wipe};
use crate::error::{Error, Result};
use crate::io::sequence::Sequence;
use crate::io::{is_same_file, write_atomically};
use crate::picture::drawing::{Anchor, Drawing, Ink, Shape};
use crate::picture::false_colour::false_colour;
use crate::picture::pixels::pixmap;
use crate::picture::raster::{draw_over, text_width};

/// Tiles are this wide, larger frames are made smaller by a whole number, smaller ones larger.
const TILE: (usize, usize) = (240, 960);
/// The sheet is at most about this wide.
const WIDE: usize = 4000;
/// Around and between tiles, and the height of a line of words.
const GAP: usize = 12;
const LINE: usize = 22;
/// The scale of change.
const BAR: (usize, usize) = (200, 12);
/// The legend's width.
const LEGEND: usize = 640;
/// The size of words.
const TEXT: f64 = 13.0;

/// How to show a preview.
#[derive(Clone, Copy, Debug, Default)]
pub struct SheetOptions {
    /// Stops brighter.
    pub exposure: f64,
    /// Each denoised tile shows the rendered frame left of this place, 0…1 of its width.
    pub before_after: Option<f64>,
}

/// A tile with the words above it.
struct Cell {
    row: usize,
    column: usize,
    words: String,
    picture: Option<Pixmap>,
    /// A line down, in pixels of the picture.
    line: Option<usize>,
}

/// The sheet as PNG.
///
/// # Errors
/// It would be larger than a picture can be.
pub fn sheet(preview: &Preview, options: &SheetOptions) -> Result<Vec<u8>> {
    let across = 1 + preview.layers.iter().map(|l| in_a_row(&l.variants)).max().unwrap_or(0);
    let most = TILE.1.min(WIDE / across).max(TILE.0);
    let scale = Scale::for_width(preview.region.width, TILE.0, most);
    let cells = cells(preview, scale, options);
    let down = cells.iter().map(|c| c.row + 1).max().unwrap_or(0);
    let flickers = preview.layers.iter().any(|l| l.flicker.is_some());
    let (wide, high) = (scale.side(preview.region.width), scale.side(preview.region.height));
    let head = headline(preview, scale, options);
    let words = head.iter().map(|t| text_width(t, TEXT).ceil() as usize).max().unwrap_or(0);
    let width = (GAP + across * (wide + GAP)).max(2 * GAP + words.max(if flickers { LEGEND } else { 0 }));
    let height = GAP + LINE * head.len() + down * (LINE + high + GAP) + if flickers { LINE + GAP } else { 0 };
    let too_large =
        || Error::BadSetting { name: "region", reason: format!("makes a sheet of {width}×{height} pixels: ask for less") };
    let size = (u32::try_from(width).map_err(|_| too_large())?, u32::try_from(height).map_err(|_| too_large())?);
    let mut page = Pixmap::new(size.0, size.1).ok_or_else(too_large)?;
    page.fill(Color::WHITE);
    let mut drawing = Drawing::new(width as f64, height as f64, "Preview");
    for (i, text) in head.iter().enumerate() {
        drawing.add([words_at(GAP, GAP + LINE * i, text, Ink::Text)]);
    }
    let top = GAP + LINE * head.len();
    for cell in &cells {
        let (x, y) = (GAP + cell.column * (wide + GAP), top + cell.row * (LINE + high + GAP));
        drawing.add([words_at(x, y, &fitting(&cell.words, wide as f64), Ink::Text)]);
        if let Some(picture) = &cell.picture {
            put(&mut page, picture, x, y + LINE);
        }
        if let Some(at) = cell.line {
            let x = (x + at) as f64;
            let points = vec![(x, (y + LINE) as f64), (x, (y + LINE + high) as f64)];
            drawing.add([Shape::Line { points, ink: Ink::Grid, width: 1.0, dashed: false }]);
        }
    }
    if flickers {
        legend(&mut page, &mut drawing, top + down * (LINE + high + GAP));
    }
    draw_over(&mut page, &drawing, 1.0);
    page.encode_png().map_err(|e| Error::BadInput { input: "sheet".into(), reason: e.to_string() })
}

/// Whether a sheet may be written there; to be asked before the work.
///
/// # Errors
/// The name is not that of a PNG, or the file is one of the frames.
pub fn check_sheet(path: &Path, frames: &Sequence) -> Result<()> {
    check_name(path)?;
    match frames.frames.iter().any(|frame| is_same_file(&frame.path, path)) {
        true => Err(Error::BadSetting { name: "output", reason: "is one of the frames".into() }),
        false => Ok(()),
    }
}

fn check_name(path: &Path) -> Result<()> {
    if path.extension().is_some_and(|e| e.eq_ignore_ascii_case("png")) {
        return Ok(());
    }
    let reason = format!("{} is no name of a PNG: give one that ends in .png", path.display());
    Err(Error::BadSetting { name: "output", reason })
}

/// Writes the sheet, whole or not at all.
///
/// # Errors
/// As [`sheet`], and where the name is not that of a PNG or the file cannot be written.
pub fn write_sheet(preview: &Preview, options: &SheetOptions, path: &Path) -> Result<()> {
    use std::io::Write;
    check_name(path)?;
    let bytes = sheet(preview, options)?;
    write_atomically(path, |file| file.write_all(&bytes).map_err(|e| Error::io(path, e)))
}

/// Variants of one window side by side.
fn in_a_row(variants: &[Variant]) -> usize {
    let first = variants.first().map(|v| v.window);
    variants.iter().take_while(|v| Some(v.window) == first).count()
}

/// A row for each window, λ by λ, after the rendered frame; below each row what flickers.
fn cells(preview: &Preview, scale: Scale, options: &SheetOptions) -> Vec<Cell> {
    let (mut cells, mut row) = (Vec::new(), 0);
    for layer in &preview.layers {
        let name = if preview.layers.len() > 1 { format!("{} · ", layer.name) } else { String::new() };
        let in_a_row = in_a_row(&layer.variants).max(1);
        let with_flicker = layer.flicker.is_some();
        cells.push(Cell {
            row,
            column: 0,
            words: format!("{name}noisy"),
            picture: light(layer.noisy.view(), scale, options.exposure),
            line: None,
        });
        cells.extend(layer.flicker.as_ref().map(|f| flicker_cell((row + 1, 0), f, scale)));
        for (index, variant) in layer.variants.iter().enumerate() {
            let place = (row + index / in_a_row * if with_flicker { 2 } else { 1 }, 1 + index % in_a_row);
            cells.push(variant_cell(place, layer, variant, &name, (scale, options)));
            cells.extend(variant.flicker.as_ref().map(|f| flicker_cell((place.0 + 1, place.1), f, scale)));
        }
        row = cells.iter().map(|c| c.row + 1).max().unwrap_or(row);
    }
    cells
}

fn variant_cell(
    (row, column): (usize, usize),
    layer: &LayerPreview,
    variant: &Variant,
    name: &str,
    (scale, options): (Scale, &SheetOptions),
) -> Cell {
    let picture = match options.before_after {
        Some(at) => light(wipe(layer.noisy.view(), variant.colour.view(), at).view(), scale, options.exposure),
        None => light(variant.colour.view(), scale, options.exposure),
    };
    let columns = scale.side(variant.colour.dim().1);
    Cell {
        row,
        column,
        words: format!("{name}λ {}, window {}", variant.lambda, variant.window),
        picture,
        line: options.before_after.map(|at| line(at, columns)),
    }
}

fn flicker_cell((row, column): (usize, usize), flicker: &Flicker, scale: Scale) -> Cell {
    let mean = flicker.mean.map_or("nothing to compare".into(), |mean| format!("{:.1} % on average", 100.0 * mean));
    Cell { row, column, words: format!("change: {mean}"), picture: change(flicker.change.view(), scale), line: None }
}

/// What is shown, and how.
fn headline(preview: &Preview, scale: Scale, options: &SheetOptions) -> Vec<String> {
    let r = preview.region;
    let whole = (r.width, r.height) == (preview.columns, preview.rows);
    let part = if whole { String::new() } else { format!("{}×{} at {},{} of ", r.width, r.height, r.x, r.y) };
    let size = scale.text().map(|text| format!(", shown {text}")).unwrap_or_default();
    let stops = if options.exposure == 0.0 { String::new() } else { format!(", exposure {:+} EV", options.exposure) };
    let wiped = if options.before_after.is_some() { "; left of the line: noisy" } else { "" };
    vec![
        format!("{}, frame {}, {part}{}×{}{size}", preview.sequence, preview.frame, preview.columns, preview.rows),
        format!("linear to sRGB{stops}{wiped}"),
    ]
}

/// The scale of change: its colours with numbers.
fn legend(page: &mut Pixmap, drawing: &mut Drawing, y: usize) {
    let bar = pixmap(BAR.1, BAR.0, |_, x| false_colour(x as f64 / (BAR.0 - 1) as f64));
    let grey = pixmap(BAR.1, BAR.1, |_, _| NOWHERE);
    let zero = "0";
    let x = GAP + text_width(zero, TEXT) as usize + 6;
    let text = format!("{:.0} % and more, against the frame before along the motion", 100.0 * MOST_CHANGE);
    let after = x + BAR.0 + 6;
    let square = after + text_width(&text, TEXT) as usize + 18;
    drawing.add([
        words_at(GAP, y, zero, Ink::Text),
        words_at(after, y, &text, Ink::Text),
        words_at(square + BAR.1 + 6, y, "not in it", Ink::Text),
    ]);
    for (picture, x) in [(bar, x), (grey, square)] {
        if let Some(picture) = picture {
            put(page, &picture, x, y + 4);
        }
    }
}

/// Words cut to a width.
fn fitting(text: &str, width: f64) -> String {
    if text_width(text, TEXT) <= width {
        return text.into();
    }
    let count = text.chars().count();
    let cut = |kept: usize| text.chars().take(kept).chain(['…']).collect::<String>();
    (0..count).rev().map(cut).find(|t| text_width(t, TEXT) <= width).unwrap_or_default()
}

/// Words in a line of the sheet.
fn words_at(x: usize, y: usize, text: &str, ink: Ink) -> Shape {
    Shape::Text { x: x as f64, y: y as f64 + TEXT + 1.0, text: text.into(), size: TEXT, anchor: Anchor::Start, ink }
}

fn put(page: &mut Pixmap, picture: &Pixmap, x: usize, y: usize) {
    page.draw_pixmap(x as i32, y as i32, picture.as_ref(), &PixmapPaint::default(), Transform::identity(), None);
}
