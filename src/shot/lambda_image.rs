//! The image that is the mask of a frame's λ, where that is no pass of the frame's own file.

use super::file_state::FileState;
use super::prepare::{Plan, PlannedFrame};
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
    /// Reads that of a frame; None where it has none.
    pub fn read(plan: &Plan, target: &PlannedFrame) -> Option<Result<Self>> {
        let path = target.lambda_image.as_ref()?;
        let view = plan.sources.good.get(&target.frame)?.views.first()?;
        let state = FileState::read(path);
        let image = read_lambda_image(path, (view.rows, view.columns));
        Some(image.map(|image| Self { mask: LambdaMask::new(image.view()), state }))
    }
}
