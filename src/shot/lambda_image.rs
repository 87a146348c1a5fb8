//! The image that is the mask of a frame's λ, where that is no pass of the frame's own file.

use std::path::Path;

use super::file_state::FileState;
use super::prepare::Plan;
use crate::engine::LambdaMask;
use crate::error::Result;
use crate::io::read_lambda_image;

/// The mask of a frame.
pub(super) struct LambdaImage {
    pub mask: LambdaMask,
    /// The file that was read.
    pub state: Option<FileState>,
}

impl LambdaImage {
    /// Reads that of a frame from its file; None where it has none.
    pub fn read(plan: &Plan, frame: i64, path: Option<&Path>) -> Option<Result<Self>> {
        let path = path?;
        let view = plan.sources.good.get(&frame)?.views.first()?;
        let state = FileState::read(path);
        let image = read_lambda_image(path, (view.rows, view.columns));
        Some(image.map(|image| Self { mask: LambdaMask::new(image.view()), state }))
    }
}
