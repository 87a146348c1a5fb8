//! Files in and out.

pub mod sequence;
