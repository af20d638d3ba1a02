//! Disparities of a pair of rectified infrared images.

use super::{
    census::census_image, semi_global::summed_costs, speckle::drop_speckles, subpixel::refine_disparities,
    winner::disparity_image,
};

/// Number of disparities, share of the image's width; rounded up to a multiple of [`LANES`].
/// chosen: 128 of 728 pixels, as the D4 chips have
const DISPARITY_SHARE: f64 = 0.16;
const LANES: usize = 32;
/// Pixels of the smallest island that stays, share of the image. chosen: 120 of 728 x 496 pixels
const SPECKLE_SHARE: f64 = 1.0 / 3000.0;

/// Disparities of the left image, pixels, row-major; `NAN` for none.
pub(super) fn matched_disparities(left: &[u8], right: &[u8], width: usize) -> Vec<f32> {
    let disparities = ((DISPARITY_SHARE * width as f64) as usize + 1).next_multiple_of(LANES);
    let [left_census, right_census] = [left, right].map(|gray| census_image(gray, width));
    let volume = summed_costs(&left_census, &right_census, width, disparities);
    let mut disparity = disparity_image(&volume, width);
    refine_disparities(left, right, width, &mut disparity);
    drop_speckles(&mut disparity, width, (SPECKLE_SHARE * left.len() as f64) as usize);
    disparity
}
