//! From a frame's passes to what the engine keeps of it in the window.

use std::sync::Arc;

use super::{EncodedFrame, Engine, Scales, Stage};
use crate::error::{Error, Result};
use crate::frame::packed::{GuideViews, PackedFrame};
use crate::frame::ranges::Ranges;
use crate::frame::{Frame, FrameView};
use crate::network::features::Features;

impl Engine {
    /// Sanitises a frame and computes its features (source encoder). Done once a frame.
    ///
    /// Errors where passes differ in size or the frame is empty.
    ///
    /// ```
    /// # use hush::{Engine, Error, Frame, Settings};
    /// # use ndarray::Array3;
    /// # let engine = Engine::new(Settings::default())?;
    /// let mut frame = Frame::new(Array3::zeros((8, 8, 3)));
    /// frame.albedo = Some(Array3::zeros((8, 9, 3)));
    /// assert!(matches!(engine.encode(frame), Err(Error::SizeMismatch { .. })));
    /// # Ok::<(), Error>(())
    /// ```
    pub fn encode(&self, frame: Frame) -> Result<EncodedFrame> {
        self.clock.time(Stage::Encode, || {
            let packed = self.pack(&frame.view(), None)?;
            // Of the frame only the guides are needed from here on: large frames want the memory.
            let Frame { albedo, normal, .. } = frame;
            let guides = GuideViews { albedo: albedo.as_ref().map(|a| a.view()), normal: normal.as_ref().map(|n| n.view()) };
            Ok(self.finish_encoding(packed, &guides))
        })
    }

    /// As [`Engine::encode`], for passes that lie elsewhere, in any layout; none of them is copied.
    pub fn encode_view(&self, frame: &FrameView) -> Result<EncodedFrame> {
        self.clock.time(Stage::Encode, || {
            let guides = GuideViews { albedo: frame.albedo, normal: frame.normal };
            Ok(self.finish_encoding(self.pack(frame, None)?, &guides))
        })
    }

    /// As [`encode_view`](Self::encode_view), for a part of a frame with the whole one's [`scales`](Self::scales): what it looks
    /// like does not depend on how it was cut, but for the pixels near its borders.
    pub fn encode_part(&self, part: &FrameView, scales: Scales) -> Result<EncodedFrame> {
        self.clock.time(Stage::Encode, || {
            let guides = GuideViews { albedo: part.albedo, normal: part.normal };
            Ok(self.finish_encoding(self.pack(part, Some(scales))?, &guides))
        })
    }

    /// Exposure and depth of a whole frame, for [`encode_part`](Self::encode_part).
    ///
    /// # Errors
    /// Passes differ in size.
    pub fn scales(&self, frame: &FrameView) -> Result<Scales> {
        frame.check()?;
        Ok(self.in_pool(|| Scales::of(frame)))
    }

    /// As [`encode`](Self::encode) without the features: enough for [`left_out`](Self::left_out); it cannot be denoised or help.
    pub fn look(&self, frame: &Frame) -> Result<EncodedFrame> {
        let packed = self.pack(&frame.view(), None)?;
        Ok(EncodedFrame {
            ranges: self.in_pool(|| Ranges::new(&packed)),
            packed,
            features: Arc::new(Features::new(0, 0, 0, &self.buffers)),
        })
    }

    fn pack(&self, frame: &FrameView, scales: Option<Scales>) -> Result<PackedFrame> {
        let (rows, columns) = frame.size();
        if rows == 0 || columns == 0 {
            return Err(Error::BadInput { input: "frame".into(), reason: format!("{columns}×{rows} has no pixels") });
        }
        self.in_pool(|| match scales {
            Some(scales) => PackedFrame::scaled(frame, self.epsilon, scales, &self.buffers),
            None => PackedFrame::new(frame, self.epsilon, &self.buffers),
        })
    }

    fn finish_encoding(&self, packed: PackedFrame, guides: &GuideViews) -> EncodedFrame {
        self.in_pool(|| {
            let features = self.encoder.run(self.isa, &packed, guides, &self.buffers);
            EncodedFrame { ranges: Ranges::new(&packed), packed, features: Arc::new(features) }
        })
    }
}
