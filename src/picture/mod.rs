//! Pictures for people: drawings as SVG and PNG, pixels as PNG, false colours. Shared by [`report`](crate::report) and
//! [`preview`](crate::preview).

pub mod drawing;
pub mod false_colour;
pub mod pixels;
pub mod raster;
