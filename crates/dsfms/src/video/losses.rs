//! Pictures that are lost one after the other, and how many of them a video may have.

use super::frame::VideoFrame;

/// Most pictures in a row that are lost one by one, two minutes at 25 a second. Longer damage is
/// told once: a file of 16 bytes a picture states millions of them, each of which would be a file
/// of the output.
pub(super) const MOST_LOST: usize = 3000;

/// Hands frames on until too many in a row are lost.
pub(super) struct Losses<'a> {
    each: &'a mut dyn FnMut(VideoFrame) -> bool,
    /// Lost before the first picture, and given with it: a file without any gives nothing where
    /// they are too many.
    leading: Vec<VideoFrame>,
    decoded: bool,
    /// Lost since the last picture, and why the first of them is.
    row: usize,
    reason: String,
}

impl<'a> Losses<'a> {
    pub(super) fn new(each: &'a mut dyn FnMut(VideoFrame) -> bool) -> Self {
        Self { each, leading: Vec::new(), decoded: false, row: 0, reason: String::new() }
    }

    /// The next frame; `false` where no more are wanted.
    pub(super) fn give(&mut self, frame: VideoFrame) -> bool {
        match &frame.content {
            Ok(_) => (self.decoded, self.row) = (true, 0),
            Err(reason) => {
                if self.row == 0 {
                    self.reason.clone_from(reason);
                }
                self.row += 1;
            }
        }
        if self.too_many().is_some() {
            return false;
        }
        if self.decoded {
            return self.finish() && (self.each)(frame);
        }
        self.leading.push(frame);
        true
    }

    /// Why the first picture of too many in a row is lost.
    pub(super) fn too_many(&self) -> Option<&str> {
        (self.row > MOST_LOST).then_some(&self.reason)
    }

    /// Give what waits for a picture; `false` where no more is wanted.
    pub(super) fn finish(&mut self) -> bool {
        self.leading.drain(..).all(&mut self.each)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::Frame;

    /// The numbers that come out of pictures (`true`) and losses, and whether there were too many.
    fn given(pictures: impl Iterator<Item = bool>) -> (Vec<usize>, bool) {
        let mut numbers = Vec::new();
        let mut each = |frame: VideoFrame| {
            numbers.push(frame.number);
            true
        };
        let mut losses = Losses::new(&mut each);
        for (number, there) in pictures.enumerate() {
            let frame = Frame { name: String::new(), size: [1, 1], rgb: vec![[0; 3]] };
            let content = if there { Ok(frame) } else { Err(format!("lost {number}")) };
            if !losses.give(VideoFrame { number, total: None, content, rests_on: None }) {
                break;
            }
        }
        let too_many = losses.too_many().map(str::to_owned);
        if too_many.is_none() {
            losses.finish();
        }
        (numbers, too_many.is_some())
    }

    #[test]
    fn losses_keep_their_numbers_until_they_are_too_many() {
        assert_eq!(given([false, false, true, false].into_iter()), (vec![0, 1, 2, 3], false));
        assert_eq!(given([false, false].into_iter()), (vec![0, 1], false));
        let (lost, one) = (|| std::iter::repeat_n(false, MOST_LOST), || std::iter::once(true));
        assert_eq!(given(lost().chain(one())).0.len(), MOST_LOST + 1);
        // Without a picture none is given, behind one as many as are believed.
        assert_eq!(given(lost().chain(lost())), (vec![], true));
        let (numbers, too_many) = given(one().chain(lost()).chain(lost()));
        assert!(too_many && numbers.len() == MOST_LOST + 1);
    }
}
