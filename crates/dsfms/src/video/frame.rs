//! One picture of a video.

use crate::image::Frame;

/// One decoded picture.
pub(super) struct DecodedPicture {
    pub(super) size: [usize; 2],
    pub(super) rgb: Vec<[u8; 3]>,
}

impl DecodedPicture {
    pub(super) fn into_frame(self, number: usize) -> Frame {
        Frame { name: frame_name(number), size: self.size, rgb: self.rgb }
    }
}

/// A frame of a video, or its loss.
#[derive(Clone, Debug)]
pub struct VideoFrame {
    /// Place in the video by the container's time stamps, from 0.
    pub number: usize,
    /// Frames of the video, where the container says so.
    pub total: Option<usize>,
    /// The picture under [`frame_name`], or why it is lost.
    pub content: Result<Frame, String>,
    /// A lost frame from which this one is predicted, directly or through others: parts of it may
    /// show what was before the loss.
    pub rests_on: Option<usize>,
}

/// The name of a frame of a video: `frame_NNN` by its 0-based number.
pub fn frame_name(number: usize) -> String {
    format!("frame_{number:03}")
}
