//! A drawing of lines, discs, bars and words, as SVG for the page and for itself; [`super::raster`] makes a PNG of it.

use std::fmt::Write;

use maud::{Markup, PreEscaped, Render, html};

/// What something is painted with; the page and the file have one colour each for light and for dark.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ink {
    /// Words and axes.
    Text,
    /// Lesser words.
    Muted,
    /// Grid lines.
    Grid,
    /// The Pareto front.
    Front,
    /// One of [`SERIES`].
    Series(usize),
}

/// What is drawn on, by light and by dark, in the page as well.
const PAPER: &str = "#fff";
const DARK_PAPER: &str = "#16181c";

/// Colours of series, (light, dark).
pub const SERIES: [(&str, &str); 12] = [
    ("#8a8f98", "#8a919c"),
    ("#0b57d0", "#7db1ff"),
    ("#7fb3ff", "#3f6fc4"),
    ("#3f86f0", "#5a93ee"),
    ("#07337d", "#b4d2ff"),
    ("#e07b00", "#ffb35c"),
    ("#a85200", "#d98a2b"),
    ("#00857a", "#4fd1c5"),
    ("#8e44ad", "#c79be0"),
    ("#5b2275", "#e3c8f2"),
    ("#c62828", "#ff8a80"),
    ("#5f6b3a", "#c3d08a"),
];

impl Ink {
    /// (light, dark).
    pub fn colours(self) -> (&'static str, &'static str) {
        match self {
            Self::Text => ("#1c1f24", "#e6e8eb"),
            Self::Muted => ("#646b76", "#9aa2ad"),
            Self::Grid => ("#e3e6ea", "#31353c"),
            Self::Front => ("#b9bfc8", "#5a616b"),
            Self::Series(i) => SERIES[i % SERIES.len()],
        }
    }

    fn class(self) -> String {
        match self {
            Self::Text => "i-text".into(),
            Self::Muted => "i-muted".into(),
            Self::Grid => "i-grid".into(),
            Self::Front => "i-front".into(),
            Self::Series(i) => format!("i-{}", i % SERIES.len()),
        }
    }
}

/// Which end of a text is at its place.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Anchor {
    Start,
    Middle,
    End,
}

impl Anchor {
    fn name(self) -> &'static str {
        match self {
            Self::Start => "start",
            Self::Middle => "middle",
            Self::End => "end",
        }
    }
}

/// Something drawn.
#[derive(Clone, Debug)]
pub enum Shape {
    /// A line through points.
    Line { points: Vec<(f64, f64)>, ink: Ink, width: f64, dashed: bool },
    /// A disc; hollow ones have a ring only.
    Disc { x: f64, y: f64, radius: f64, ink: Ink, hollow: bool },
    /// A filled rectangle.
    Bar { x: f64, y: f64, width: f64, height: f64, ink: Ink },
    /// Words with a halo of the paper's colour; `y` is their baseline.
    Text { x: f64, y: f64, text: String, size: f64, anchor: Anchor, ink: Ink },
}

/// Shapes that belong to one thing: a row of the table, with words to show when it is pointed at.
#[derive(Clone, Debug, Default)]
pub struct Group {
    /// Index of the table's row.
    pub row: Option<usize>,
    pub title: Option<String>,
    pub shapes: Vec<Shape>,
}

/// A drawing of some size.
#[derive(Clone, Debug)]
pub struct Drawing {
    pub width: f64,
    pub height: f64,
    /// What it shows, for those who cannot see it.
    pub about: String,
    pub groups: Vec<Group>,
}

impl Drawing {
    /// An empty one.
    pub fn new(width: f64, height: f64, about: impl Into<String>) -> Self {
        Self { width, height, about: about.into(), groups: Vec::new() }
    }

    /// Adds shapes that belong to nothing.
    pub fn add(&mut self, shapes: impl IntoIterator<Item = Shape>) {
        self.groups.push(Group { shapes: shapes.into_iter().collect(), ..Group::default() });
    }

    /// For a page that has the [`styles`].
    pub fn inline(&self) -> Markup {
        self.svg(false)
    }

    /// A file of its own.
    pub fn file(&self) -> String {
        format!("<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n{}\n", self.svg(true).into_string())
    }

    fn svg(&self, alone: bool) -> Markup {
        let (w, h) = (self.width, self.height);
        let space = alone.then_some("http://www.w3.org/2000/svg");
        html! {
            svg xmlns=[space] viewBox={ "0 0 " (w) " " (h) } width=(w) height=(h) role="img" {
                title { (printable(&self.about)) }
                @if alone { style { (PreEscaped(styles())) } }
                @for group in &self.groups {
                    g class=[group.row.map(|_| "pick")] data-row=[group.row] {
                        @if let Some(title) = &group.title { title { (printable(title)) } }
                        @for shape in &group.shapes { (shape) }
                    }
                }
            }
        }
    }
}

impl Render for Shape {
    /// An element with its closing tag, which XML wants of every one.
    fn render(&self) -> Markup {
        let to = |v: &f64| format!("{v:.1}");
        match self {
            Self::Line { points, ink, width, dashed } => {
                let points: Vec<String> = points.iter().map(|(x, y)| format!("{x:.1},{y:.1}")).collect();
                let dashes = dashed.then_some("5 4");
                html! { polyline class={ "l " (ink.class()) } points=(points.join(" ")) stroke-width=(width) stroke-dasharray=[dashes] {} }
            }
            Self::Disc { x, y, radius, ink, hollow } => {
                let (kind, ring) = if *hollow { ("l ", Some(2)) } else { ("f ", None) };
                html! { circle class={ (kind) (ink.class()) } cx=(to(x)) cy=(to(y)) r=(radius) stroke-width=[ring] {} }
            }
            Self::Bar { x, y, width, height, ink } => {
                html! { rect class={ "f " (ink.class()) } x=(to(x)) y=(to(y)) width=(to(width)) height=(to(height)) {} }
            }
            Self::Text { x, y, text, size, anchor, ink } => {
                let (class, text) = (ink.class(), printable(text));
                html! { text class={ "f h " (class) } x=(to(x)) y=(to(y)) font-size=(size) text-anchor=(anchor.name()) { (text) } }
            }
        }
    }
}

/// The style sheet of drawings, with the colours of light and dark.
pub fn styles() -> String {
    let inks = [Ink::Text, Ink::Muted, Ink::Grid, Ink::Front].into_iter().chain((0..SERIES.len()).map(Ink::Series));
    let (mut light, mut dark) = (String::new(), String::new());
    for ink in inks {
        let (class, (day, night)) = (ink.class(), ink.colours());
        let _ = write!(light, ".l.{class}{{stroke:{day}}}.f.{class},.b.{class}{{fill:{day};background:{day}}}");
        let _ = write!(dark, ".l.{class}{{stroke:{night}}}.f.{class},.b.{class}{{fill:{night};background:{night}}}");
    }
    format!(
        "svg{{font-family:'DejaVu Sans',Verdana,sans-serif;background:{PAPER}}}.l{{fill:none;stroke-linejoin:round}}\
         .h{{paint-order:stroke;stroke:{PAPER};stroke-width:4px;stroke-linejoin:round}}{light}\
         @media (prefers-color-scheme:dark){{svg{{background:{DARK_PAPER}}}.h{{stroke:{DARK_PAPER}}}{dark}}}"
    )
}

/// Text for XML and HTML: control characters and what XML does not count as characters are none, whatever a file is called.
pub fn printable(text: &str) -> String {
    let is_bad = |c: char| c.is_control() && !matches!(c, '\n' | '\t') || matches!(c, '\u{fffe}' | '\u{ffff}');
    text.replace(is_bad, "\u{fffd}")
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    pub fn sample() -> Drawing {
        let mut drawing = Drawing::new(200.0, 100.0, "A <sample> & \"more\"\u{1}\u{ffff}");
        drawing.add([
            Shape::Line { points: vec![(0.0, 0.0), (50.0, 50.0)], ink: Ink::Grid, width: 1.0, dashed: true },
            Shape::Bar { x: 100.0, y: 20.0, width: 60.0, height: 40.0, ink: Ink::Series(1) },
        ]);
        let text = Shape::Text { x: 20.0, y: 90.0, text: "λ 4 <b>".into(), size: 12.0, anchor: Anchor::Start, ink: Ink::Text };
        let disc = Shape::Disc { x: 30.0, y: 30.0, radius: 5.0, ink: Ink::Series(10), hollow: false };
        drawing.groups.push(Group { row: Some(3), title: Some("three & four".into()), shapes: vec![disc, text] });
        drawing
    }

    #[test]
    fn the_file_and_the_inline_form_are_sound_xml() {
        for text in [sample().file(), sample().inline().into_string()] {
            let document = roxmltree::Document::parse(&text).unwrap_or_else(|e| panic!("{e}: {text}"));
            let root = document.root_element();
            assert_eq!(root.attribute("viewBox"), Some("0 0 200 100"));
            let count = |name: &str| document.descendants().filter(|n| n.tag_name().name() == name).count();
            assert_eq!((count("polyline"), count("rect"), count("circle"), count("text"), count("title")), (1, 1, 1, 1, 2));
            assert!(document.descendants().any(|n| n.attribute("data-row") == Some("3")));
            assert!(document.descendants().any(|n| n.text() == Some("λ 4 <b>")));
        }
        assert!(!sample().inline().into_string().contains("://"));
    }
}
