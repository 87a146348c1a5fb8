//! A drawing as PNG, in the colours of light, with a font of its own so that every machine draws the same.

use std::sync::{Arc, LazyLock};

use resvg::tiny_skia::{Color, Pixmap, Transform};
use resvg::usvg::{Options, Tree, fontdb};
use skrifa::instance::{LocationRef, Size};
use skrifa::{FontRef, MetadataProvider};

use super::drawing::Drawing;

/// The Latin part of DejaVu Sans; its licence lies beside it.
const FONT: &[u8] = include_bytes!("../../assets/DejaVuSans-subset.ttf");

static FONTS: LazyLock<Arc<fontdb::Database>> = LazyLock::new(|| {
    let mut fonts = fontdb::Database::new();
    fonts.load_font_data(FONT.to_vec());
    Arc::new(fonts)
});

/// A PNG of `scale` pixels a unit. None where the size is none that a picture can have.
pub fn png(drawing: &Drawing, scale: f32) -> Option<Vec<u8>> {
    let side = |v: f64| (v as f32 * scale).round() as u32;
    let mut pixmap = Pixmap::new(side(drawing.width), side(drawing.height))?;
    pixmap.fill(Color::WHITE);
    draw_over(&mut pixmap, drawing, scale);
    pixmap.encode_png().ok()
}

/// Draws over a picture, `scale` pixels a unit.
pub fn draw_over(pixmap: &mut Pixmap, drawing: &Drawing, scale: f32) {
    let options = Options { fontdb: FONTS.clone(), ..Options::default() };
    if let Ok(tree) = Tree::from_str(&drawing.file(), &options) {
        resvg::render(&tree, Transform::from_scale(scale, scale), &mut pixmap.as_mut());
    }
}

/// How wide a text is at a size.
pub fn text_width(text: &str, size: f64) -> f64 {
    let Ok(font) = FontRef::new(FONT) else { return 0.0 };
    let (letters, metrics) = (font.charmap(), font.glyph_metrics(Size::new(size as f32), LocationRef::default()));
    let width = |c: char| letters.map(c).or_else(|| letters.map('?')).and_then(|glyph| metrics.advance_width(glyph));
    text.chars().filter_map(width).map(f64::from).sum()
}

#[cfg(test)]
mod tests {
    use super::super::drawing::tests::sample;
    use super::*;

    #[test]
    fn shapes_and_words_leave_their_colours() {
        let bytes = png(&sample(), 2.0).unwrap();
        let picture = Pixmap::decode_png(&bytes).unwrap();
        assert_eq!((picture.width(), picture.height()), (400, 200));
        let at = |x: u32, y: u32| picture.pixel(2 * x, 2 * y).map(|p| (p.red(), p.green(), p.blue())).unwrap();
        assert_eq!(at(130, 40), (0x0b, 0x57, 0xd0));
        assert_eq!(at(30, 30), (0xc6, 0x28, 0x28));
        assert_eq!(at(190, 5), (255, 255, 255));
        let dark = (20..80).flat_map(|x| (78..95).map(move |y| (x, y))).filter(|(x, y)| at(*x, *y).0 < 100).count();
        assert!(dark > 40, "{dark} dark pixels of words");
    }

    #[test]
    fn the_font_has_every_letter_that_is_used() {
        let letters = FontRef::new(FONT).unwrap().charmap();
        let all = (' '..='~').chain("λ±×–—…·²≤→−".chars());
        assert!(
            all.clone().all(|c| letters.map(c).is_some()),
            "{:?}",
            all.filter(|c| letters.map(*c).is_none()).collect::<Vec<_>>()
        );
        assert!(text_width("mm", 10.0) > text_width("ii", 10.0) && text_width("", 10.0) == 0.0);
    }
}
