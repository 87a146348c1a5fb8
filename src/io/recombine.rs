//! Taking denoised contributions apart again into light pass and Color pass.

use std::collections::HashMap;

use half::f16;
use ndarray::{Array2, Axis, Zip};

use super::exr_file::ExrFile;
use super::layout::{Channel, Layout, SampleType};
use super::read::read_planes;
use super::resolved::Resolved;
use crate::error::Result;
use crate::frame::Aov;

/// Below this a Color value is not divided by: it is raised to it where the contribution is not zero.
const LEAST_COLOUR: f32 = 1e-4;
/// The same where lossy compression (DWA, B44) would round 1e-4 away.
const LEAST_LOSSY_COLOUR: f32 = 1.0 / 64.0;

/// Part and channel index.
pub(crate) type ChannelPlace = (usize, usize);

/// The planes to write for the light passes of `resolved`: contribution ÷ Color, and those Color planes that had to be raised.
///
/// Where Color is below 1e-4 (or not a number) and the contribution is not zero, the written Color is raised so that
/// Color × pass equals the contribution to the precision of the pass's type; in half-float files a little further where the
/// quotient would overflow otherwise, and to 1/64 under DWA and B44, which round small numbers away. Contributions without
/// Color pass are written as they are.
pub(crate) fn light_planes(
    layout: &Layout,
    source: &mut ExrFile,
    resolved: &Resolved,
    aovs: &[Aov],
) -> Result<HashMap<ChannelPlace, Array2<f32>>> {
    let size = (resolved.rows, resolved.columns);
    let mut colours: HashMap<ChannelPlace, Array2<f32>> = HashMap::new();
    let channels: Vec<Channel> =
        resolved.aovs.iter().filter_map(|a| a.colour.as_ref()).flat_map(|c| c.channels.clone()).collect();
    for (channel, plane) in channels.iter().zip(read_planes(&layout.path, source, &channels, size)?) {
        colours.insert((channel.part, channel.index), plane);
    }
    let least = |part: usize| match layout.part_list.get(part).is_some_and(|p| p.lossy && p.compression != "PXR24") {
        true => LEAST_LOSSY_COLOUR,
        false => LEAST_COLOUR,
    };
    // First raise each Color as far as any of its light passes needs, …
    let originals = colours.clone();
    for (reference, aov) in resolved.aovs.iter().zip(aovs) {
        let Some(colour) = &reference.colour else { continue };
        for (k, (c, pass)) in colour.channels.iter().zip(&reference.pass.channels).enumerate() {
            let Some(plane) = colours.get_mut(&(c.part, c.index)) else { continue };
            let light = aov.image.index_axis(Axis(2), k);
            Zip::from(plane)
                .and(&light)
                .for_each(|value, &light| *value = raised(*value, light, least(c.part), [c.sample, pass.sample]));
        }
    }
    // … then divide by what will be written.
    let mut planes = HashMap::new();
    for (reference, aov) in resolved.aovs.iter().zip(aovs) {
        for (k, pass) in reference.pass.channels.iter().enumerate() {
            let mut plane = aov.image.index_axis(Axis(2), k).to_owned();
            let colour = reference.colour.as_ref().and_then(|c| c.channels.get(k)).and_then(|c| colours.get(&(c.part, c.index)));
            if let Some(colour) = colour {
                Zip::from(&mut plane).and(colour).for_each(|light, &c| *light = if *light == 0.0 { 0.0 } else { *light / c });
            }
            planes.insert((pass.part, pass.index), plane);
        }
    }
    planes.extend(colours.into_iter().filter(|(place, plane)| differ(&originals[place], plane)));
    Ok(planes)
}

fn differ(a: &Array2<f32>, b: &Array2<f32>) -> bool {
    a.iter().zip(b).any(|(a, b)| a.to_bits() != b.to_bits())
}

/// The Color value to write: itself where it can be divided by, else the least value that can, as its sample type stores it.
fn raised(colour: f32, light: f32, least: f32, [colour_type, pass_type]: [SampleType; 2]) -> f32 {
    if light == 0.0 && colour.is_finite() {
        return colour;
    }
    let largest = if pass_type == SampleType::Half { 6.0e4 } else { 1.0e38 };
    let least = least.max(light.abs() / largest);
    if colour.is_finite() && colour >= least {
        return colour;
    }
    match colour_type {
        SampleType::Half => f16::from_f32(least.min(65504.0)).to_f32(),
        SampleType::Float | SampleType::Uint => least,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FLOATS: [SampleType; 2] = [SampleType::Float; 2];
    const HALVES: [SampleType; 2] = [SampleType::Half; 2];

    #[test]
    fn a_usable_colour_is_left_alone() {
        for colour in [1e-4, 0.5, 20.0] {
            assert_eq!(raised(colour, 3.0, LEAST_COLOUR, FLOATS), colour);
        }
        assert_eq!(raised(0.0, 0.0, LEAST_COLOUR, FLOATS), 0.0);
        assert_eq!(raised(-1.0, 0.0, LEAST_COLOUR, HALVES), -1.0);
    }

    #[test]
    fn a_black_colour_is_raised_to_what_its_type_stores() {
        assert_eq!(raised(0.0, 3.0, LEAST_COLOUR, FLOATS), LEAST_COLOUR);
        let half = raised(0.0, 3.0, LEAST_COLOUR, HALVES);
        assert_eq!(half, f16::from_f32(half).to_f32());
        assert!((half - LEAST_COLOUR).abs() < 1e-7);
        assert_eq!(raised(f32::NAN, 0.0, LEAST_COLOUR, FLOATS), LEAST_COLOUR);
        // 3000 ÷ 1e-4 would overflow half.
        assert!(3000.0 / raised(0.0, 3000.0, LEAST_COLOUR, HALVES) < 65504.0);
    }
}
