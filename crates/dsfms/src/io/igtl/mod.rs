//! OpenIGTLink, the protocol of image-guided therapy (<http://openigtlink.org>): what we send and what
//! we read of it.
//!
//! Messages are written with headers of version 1, which versions 1 to 3 of the protocol read, and
//! read with headers of version 1 and 2. Nothing here opens a connection.
//!
//! ```
//! use dsfms::io::igtl::{Head, read, string};
//! let bytes = string(Head { device: "Verdict", time: None }, "ok");
//! let found = read(&mut bytes.as_slice(), |header| header.kind == "STRING").unwrap().unwrap();
//! assert_eq!((found.header.device.as_str(), &found.content[4..]), ("Verdict", b"ok".as_slice()));
//! ```

mod crc;
mod header;
mod image;
mod read;
mod write;

pub use crc::crc64;
pub use header::{HEADER, Head, Header, MOST_BODY};
pub use image::picture;
pub use read::{Received, read};
pub use write::{ImagePlacement, StatusCode, image, status, string, surface, transform};

/// What is wrong with a message or its stream.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum IgtlError {
    /// The stream failed, or nothing came for too long.
    #[error(transparent)]
    Stream(#[from] std::io::Error),
    /// The stream ended within a message.
    #[error("the stream ends within a message: {read} of {of} bytes")]
    Half {
        /// Bytes that came.
        read: u64,
        /// Bytes that were announced.
        of: u64,
    },
    /// A length that no message has.
    #[error("a message of {0} bytes; at most {MOST_BODY} are read")]
    TooLong(u64),
    /// No header of OpenIGTLink.
    #[error("header version {0}; 1 and 2 are known (is this OpenIGTLink?)")]
    Version(u16),
    /// A message that was changed on its way.
    #[error("its checksum is {found:#018x} but its header says {said:#018x}")]
    Crc {
        /// Of the body.
        found: u64,
        /// In the header.
        said: u64,
    },
    /// A message of another content than its kind has.
    #[error("{0}")]
    Content(String),
}

impl IgtlError {
    /// Where the next message begins is not known any more.
    pub fn fatal(&self) -> bool {
        !matches!(self, Self::Crc { .. } | Self::Content(_))
    }
}

#[cfg(test)]
mod tests;
