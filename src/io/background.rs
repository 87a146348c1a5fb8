//! The background in Denoising Depth as Blender 5.3 and newer write it: there it is as far as the camera's far clipping plane, as an end
//! of the scene as any, and on edges the mean with what stands before it. Versions before had 0 or the greatest float.

use ndarray::{Array2, Array3, ArrayView1, Axis, Zip, s};

use super::layout::Layout;

/// The first Blender whose background is as far as the clipping plane.
const SINCE: (u32, u32) = (5, 3);

/// Whether a file's Denoising Depth has the clipping plane as its background.
pub(super) fn ends_at_clipping_plane(layout: &Layout) -> bool {
    layout.software.as_deref().and_then(blender_version).is_some_and(|version| version >= SINCE)
}

/// Major and minor version of what the file says that wrote it, such as `Blender 5.3.0`.
fn blender_version(software: &str) -> Option<(u32, u32)> {
    let mut numbers = software.strip_prefix("Blender ")?.split(['.', ' ']).map(str::parse);
    Some((numbers.next()?.ok()?, numbers.next()?.ok()?))
}

/// Makes the depth of the background 0: of pixels of which more than half is background, and of those next to them, which mostly saw some of
/// it too. Where all of a pixel is, there is no normal; the greatest depth of such pixels is the background's, as a lamp has no normal
/// either. Where half is, the normal is half as long and the depth half as great.
pub(super) fn take_out(depth: &mut Array2<f32>, normal: &Array3<f32>) {
    let length = |normal: ArrayView1<f32>| normal.iter().map(|v| v * v).sum::<f32>().sqrt();
    // The depth where the normal is short, and the greatest where there is none.
    let short = Zip::from(&*depth).and(normal.lanes(Axis(2))).par_map_collect(|z, normal| match length(normal) {
        length if z.is_finite() && length < 0.5 => (*z, if length == 0.0 { *z } else { 0.0 }),
        _ => (0.0, 0.0),
    });
    let far = short.iter().map(|(_, unhit)| *unhit).fold(0.0, f32::max);
    let (rows, columns) = depth.dim();
    let background = short.indexed_iter().filter(|(_, (z, _))| far > 0.0 && *z > 0.5 * far);
    for ((y, x), _) in background {
        let near = s![y.saturating_sub(1)..(y + 2).min(rows), x.saturating_sub(1)..(x + 2).min(columns)];
        depth.slice_mut(near).fill(0.0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn versions_are_told_apart() {
        let read =
            ["Blender 5.3.0", "Blender 5.2.3 LTS", "Blender 10.0", "Blender", "Blender x.y", "Houdini 20.5"].map(blender_version);
        assert_eq!(read, [Some((5, 3)), Some((5, 2)), Some((10, 0)), None, None, None]);
        assert!(read[0] >= Some(SINCE) && read[1] < Some(SINCE) && read[2] > Some(SINCE));
    }

    #[test]
    fn the_sky_and_its_edge_go_and_the_rest_stays() {
        // Sky above ground, between them two rows of both; a lamp without a normal, and grass, whose normals are short.
        let mut depth = Array2::from_shape_fn((7, 5), |(y, _)| [1000.0, 1000.0, 600.0, 300.0, 6.0, 5.0, 4.0][y]);
        let mut normal =
            Array3::from_shape_fn((7, 5, 3), |(y, _, c)| if c == 2 { [0.0, 0.0, 0.4, 0.7, 1.0, 1.0, 0.3][y] } else { 0.0 });
        depth[[5, 4]] = 3.0;
        normal[[5, 4, 2]] = 0.0;
        let mut expected = depth.clone();
        expected.slice_mut(s![..4, ..]).fill(0.0);
        take_out(&mut depth, &normal);
        assert_eq!(depth, expected);
    }

    #[test]
    fn odd_depths_are_left_alone() {
        let odd = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, -1.0, 0.0];
        let mut depth = Array2::from_shape_fn((1, 5), |(_, x)| odd[x]);
        take_out(&mut depth, &Array3::zeros((1, 5, 3)));
        assert!(depth.iter().zip(odd).all(|(z, odd)| z.to_bits() == odd.to_bits()));
        take_out(&mut Array2::zeros((0, 0)), &Array3::zeros((0, 0, 3)));
    }
}
