//! Finding and reading the mask of λ: a pass of the frame's own file, or an image of its own.

use std::path::{Path, PathBuf};

use ndarray::Array2;

use super::layout::{Channel, Layout, Pass, SampleType, ViewLayer, read_layout};
use super::numbering::NumberPattern;
use super::pass_names;
use super::read::{open_again, read_planes};
use super::resolved::{DataWindow, PassRef};
use crate::error::{Error, Result};

/// How to get the pass, in Blender's words.
const ADVICE: &str = "add it under View Layer › Passes › Shader AOV and give the material an AOV Output node of that name";

/// Mask images, one for each frame: a file name with `####` or `%04d` for the frame's number; without, one image for all frames.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LambdaImages(PathBuf);

impl LambdaImages {
    /// Images of this name.
    pub fn new(pattern: impl Into<PathBuf>) -> Self {
        Self(pattern.into())
    }

    /// The image of a frame, which need not be there.
    pub fn path(&self, number: i64) -> PathBuf {
        let name = self.0.file_name().unwrap_or_default().to_string_lossy();
        match NumberPattern::parse(&name) {
            Ok(Some(pattern)) => self.0.with_file_name(pattern.name(number)),
            _ => self.0.clone(),
        }
    }
}

/// The channel of a pass that holds a mask: the red one of a colour, else the only one.
fn mask_channel(pass: &Pass) -> Option<&Channel> {
    let only = || pass.channels.first().filter(|_| pass.channels.len() == 1);
    pass.channel("R").or_else(|| pass.channel("X")).or_else(only).filter(|channel| channel.sample != SampleType::Uint)
}

/// The pass `name` with the channel that holds the mask, in a layer or, where that has none, in the others.
///
/// # Errors
/// [`Error::MissingPass`] where there is none; [`Error::SizeMismatch`] where it has another size than the beauty.
pub(super) fn find(
    layout: &Layout,
    layer: &ViewLayer,
    view: Option<&str>,
    name: &str,
    window: Option<DataWindow>,
) -> Result<PassRef> {
    let missing = |advice: String| Error::MissingPass { path: layout.path.clone(), pass: name.into(), advice };
    let pass = pass_names::anywhere(layout, layer, name, view)
        .ok_or_else(|| missing(format!("{ADVICE}, or name one that is there: {}", pass_names::there(layout))))?;
    let channel = mask_channel(pass).or_else(|| pass.channel(name)).cloned();
    let channel = channel.ok_or_else(|| missing("the pass is there, but it has neither one channel nor R, G, B".into()))?;
    let found = PassRef::new(layer, pass, vec![channel]);
    match (found.data_window(layout), window) {
        (Some((found_columns, found_rows, _)), Some((columns, rows, _))) if (found_columns, found_rows) != (columns, rows) => {
            let what = format!("{}: the lambda pass {name}", layout.path.display());
            Err(Error::SizeMismatch { what, columns, rows, found_columns, found_rows })
        }
        (found_window, window) if found_window != window => {
            Err(Error::bad_file(&layout.path, format!("the lambda pass {name} lies elsewhere in the frame than the beauty")))
        }
        _ => Ok(found),
    }
}

/// Reads a mask image: the first pass that has red or one channel. (rows, columns), which must be the frame's.
///
/// # Errors
/// The file cannot be read or is damaged; [`Error::MissingPass`] without such a pass; [`Error::SizeMismatch`].
pub(crate) fn read_lambda_image(path: &Path, (rows, columns): (usize, usize)) -> Result<Array2<f32>> {
    let layout = read_layout(path)?;
    let channel = layout.layers.iter().flat_map(|layer| &layer.passes).find_map(mask_channel).ok_or_else(|| {
        let advice = "save the mask as an image of one channel, or as a grey image";
        Error::MissingPass { path: path.into(), pass: "mask".into(), advice: advice.into() }
    })?;
    let size = layout.part_list.get(channel.part).map_or((layout.rows, layout.columns), |part| (part.rows, part.columns));
    if size != (rows, columns) {
        let what = format!("{}: the lambda image", path.display());
        return Err(Error::SizeMismatch { what, columns, rows, found_columns: size.1, found_rows: size.0 });
    }
    let planes = read_planes(path, &mut open_again(&layout)?, std::slice::from_ref(channel), size)?;
    planes.into_iter().next().ok_or_else(|| Error::bad_file(path, "holds no image"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_image_for_each_frame_or_one_for_all() {
        let path = |pattern: &str, number| LambdaImages::new(pattern).path(number);
        assert_eq!(path("masks/m_####.exr", 7), Path::new("masks/m_0007.exr"));
        assert_eq!(path("masks/m_%03d_x.exr", 12345), Path::new("masks/m_12345_x.exr"));
        assert_eq!(path("m_####.exr", -7), Path::new("m_-007.exr"));
        assert_eq!(path("masks/still.exr", 7), Path::new("masks/still.exr"));
    }
}
