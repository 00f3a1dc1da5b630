//! A run that is done again: which frames of its source the first run took.

use super::item::{Content, FrameItem};
use super::run_file::{RunFile, Taken};

/// A run that is done again.
pub struct Again<'a> {
    pub run: &'a RunFile,
    /// The input is its recording: frames are numbered by their names.
    pub recorded: bool,
}

/// The frames of an earlier run that are not yet done again.
pub struct Plan<'a>(pub &'a [Taken]);

impl Plan<'_> {
    /// What that run took up to an item of the same source.
    pub fn of(&mut self, item: FrameItem) -> Vec<FrameItem> {
        let mut taken = Vec::new();
        let (number, mut item) = (item.number, Some(item));
        while let [next, rest @ ..] = self.0
            && next.number <= number
        {
            self.0 = rest;
            if let Some(why) = &next.unread {
                taken.push(FrameItem::unread(next.number, why.clone()));
            } else if let Some(mut own) = item.take_if(|item| item.number == next.number) {
                if let Content::Frame(ready) = &mut own.content {
                    ready.reservation.clone_from(&next.reserved);
                    ready.answered = Some(next.answered);
                }
                taken.push(own);
            }
        }
        taken
    }

    /// What it took behind the last frame.
    pub fn rest(&mut self) -> Vec<FrameItem> {
        let rest = std::mem::take(&mut self.0);
        let unread = |t: &Taken| Some(FrameItem::unread(t.number, t.unread.clone()?));
        rest.iter().filter_map(unread).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_come_as_the_first_run_took_them() {
        let taken = |number, unread: Option<&str>| Taken {
            number,
            unread: unread.map(Into::into),
            reserved: None,
            answered: false,
        };
        // 1 was damaged, 2 dropped, 4 damaged at the end.
        let all =
            [taken(0, None), taken(1, Some("damaged")), taken(3, None), taken(4, Some("cut"))];
        let mut plan = Plan(&all);
        let mut numbers = Vec::new();
        for number in [0, 2, 3] {
            let items = plan.of(FrameItem::unread(number, "as it comes".into()));
            numbers.extend(items.iter().map(|item| item.number));
        }
        numbers.extend(plan.rest().iter().map(|item| item.number));
        assert_eq!(numbers, [0, 1, 3, 4]);
    }
}
