//! A drawing as PNG, in the colours of light, with a font of its own so that every machine draws the same.

use tiny_skia::{Color, FillRule, LineJoin, Paint, Path, PathBuilder, Pixmap, Rect, Stroke, StrokeDash, Transform};
use ttf_parser::{Face, OutlineBuilder};

use super::drawing::{Anchor, Drawing, Ink, Shape};

/// The Latin part of DejaVu Sans; its licence lies beside it.
const FONT: &[u8] = include_bytes!("../../assets/DejaVuSans-subset.ttf");

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
    let Ok(face) = Face::parse(FONT, 0) else { return };
    let transform = Transform::from_scale(scale, scale);
    for shape in drawing.groups.iter().flat_map(|g| &g.shapes) {
        draw(pixmap, &face, shape, transform);
    }
}

fn draw(pixmap: &mut Pixmap, face: &Face, shape: &Shape, transform: Transform) {
    match shape {
        Shape::Line { points, ink, width, dashed } => {
            let mut path = PathBuilder::new();
            for (i, (x, y)) in points.iter().enumerate() {
                let (x, y) = (*x as f32, *y as f32);
                if i == 0 { path.move_to(x, y) } else { path.line_to(x, y) }
            }
            let dash = if *dashed { StrokeDash::new(vec![5.0, 4.0], 0.0) } else { None };
            let stroke = Stroke { width: *width as f32, dash, ..Stroke::default() };
            if let Some(path) = path.finish() {
                pixmap.stroke_path(&path, &paint(*ink), &stroke, transform, None);
            }
        }
        Shape::Disc { x, y, radius, ink, hollow } => {
            let Some(path) = PathBuilder::from_circle(*x as f32, *y as f32, *radius as f32) else { return };
            if *hollow {
                pixmap.stroke_path(&path, &paint(*ink), &Stroke { width: 2.0, ..Stroke::default() }, transform, None);
            } else {
                pixmap.fill_path(&path, &paint(*ink), FillRule::Winding, transform, None);
            }
        }
        Shape::Bar { x, y, width, height, ink } => {
            if let Some(rect) = Rect::from_xywh(*x as f32, *y as f32, *width as f32, *height as f32) {
                pixmap.fill_rect(rect, &paint(*ink), transform, None);
            }
        }
        Shape::Text { x, y, text, size, anchor, ink } => {
            let (path, width) = outline(face, text, *size as f32);
            let shift = match anchor {
                Anchor::Start => 0.0,
                Anchor::Middle => -width / 2.0,
                Anchor::End => -width,
            };
            if let Some(path) = path {
                let transform = transform.pre_translate(*x as f32 + shift, *y as f32);
                let mut paper = Paint { anti_alias: true, ..Paint::default() };
                paper.set_color(Color::WHITE);
                let halo = Stroke { width: 4.0, line_join: LineJoin::Round, ..Stroke::default() };
                pixmap.stroke_path(&path, &paper, &halo, transform, None);
                pixmap.fill_path(&path, &paint(*ink), FillRule::Winding, transform, None);
            }
        }
    }
}

/// How wide a text is at a size.
pub fn text_width(text: &str, size: f64) -> f64 {
    Face::parse(FONT, 0).map_or(0.0, |face| f64::from(outline(&face, text, size as f32).1))
}

fn paint(ink: Ink) -> Paint<'static> {
    let hex = ink.colours().0;
    let part = |at: usize| hex.get(at..at + 2).and_then(|h| u8::from_str_radix(h, 16).ok()).unwrap_or(0);
    let mut paint = Paint { anti_alias: true, ..Paint::default() };
    paint.set_color_rgba8(part(1), part(3), part(5), 255);
    paint
}

/// The outlines of a text that starts at the origin, and its width.
fn outline(face: &Face, text: &str, size: f32) -> (Option<Path>, f32) {
    let scale = size / f32::from(face.units_per_em());
    let mut pen = Pen { path: PathBuilder::new(), x: 0.0, scale };
    for c in text.chars() {
        let glyph = face.glyph_index(c).or_else(|| face.glyph_index('?'));
        let Some(glyph) = glyph else { continue };
        face.outline_glyph(glyph, &mut pen);
        pen.x += f32::from(face.glyph_hor_advance(glyph).unwrap_or(0)) * scale;
    }
    (pen.path.finish(), pen.x)
}

/// Puts glyphs one behind the other.
struct Pen {
    path: PathBuilder,
    x: f32,
    scale: f32,
}

impl Pen {
    fn place(&self, x: f32, y: f32) -> (f32, f32) {
        (self.x + x * self.scale, -y * self.scale)
    }
}

impl OutlineBuilder for Pen {
    fn move_to(&mut self, x: f32, y: f32) {
        let (x, y) = self.place(x, y);
        self.path.move_to(x, y);
    }

    fn line_to(&mut self, x: f32, y: f32) {
        let (x, y) = self.place(x, y);
        self.path.line_to(x, y);
    }

    fn quad_to(&mut self, x1: f32, y1: f32, x: f32, y: f32) {
        let ((x1, y1), (x, y)) = (self.place(x1, y1), self.place(x, y));
        self.path.quad_to(x1, y1, x, y);
    }

    fn curve_to(&mut self, x1: f32, y1: f32, x2: f32, y2: f32, x: f32, y: f32) {
        let ((x1, y1), (x2, y2), (x, y)) = (self.place(x1, y1), self.place(x2, y2), self.place(x, y));
        self.path.cubic_to(x1, y1, x2, y2, x, y);
    }

    fn close(&mut self) {
        self.path.close();
    }
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
        let face = Face::parse(FONT, 0).unwrap();
        let all = (' '..='~').chain("λ±×–—…·²≤→−".chars());
        assert!(
            all.clone().all(|c| face.glyph_index(c).is_some()),
            "{:?}",
            all.filter(|c| face.glyph_index(*c).is_none()).collect::<Vec<_>>()
        );
        assert!(text_width("mm", 10.0) > text_width("ii", 10.0) && text_width("", 10.0) == 0.0);
    }
}
