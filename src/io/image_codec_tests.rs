//! Tests of the decoding of images.

use super::*;

fn raw(encoding: &str, width: u32, height: u32, step: u32, data: &[u8]) -> Image {
    Image { encoding: encoding.into(), width, height, step, data: data.to_vec(), ..Image::default() }
}

fn png(image: DynamicImage) -> Vec<u8> {
    let mut bytes = std::io::Cursor::new(Vec::new());
    image.write_to(&mut bytes, ImageFormat::Png).unwrap();
    bytes.into_inner()
}

fn depth_png(values: &[u16]) -> Vec<u8> {
    png(DynamicImage::ImageLuma16(
        image::ImageBuffer::from_raw(values.len() as u32, 1, values.to_vec()).unwrap(),
    ))
}

fn depth_message(format: &str, a: f32, b: f32, code: &[u8]) -> CompressedImage {
    let data = [&[0; 4], &a.to_le_bytes(), &b.to_le_bytes(), code].concat();
    CompressedImage { format: format.into(), data, ..CompressedImage::default() }
}

#[test]
fn channels_come_out_as_rgb_and_padding_is_skipped() {
    let check = |encoding, step, data: &[u8]| {
        assert_eq!(raw_color(&raw(encoding, 1, 2, step, data)).unwrap().pixels, [[1, 2, 3], [4, 5, 6]])
    };
    check("rgb8", 3, &[1, 2, 3, 4, 5, 6]);
    check("rgb8", 5, &[1, 2, 3, 9, 9, 4, 5, 6, 9, 9]);
    check("bgr8", 3, &[3, 2, 1, 6, 5, 4]);
    check("rgba8", 4, &[1, 2, 3, 0, 4, 5, 6, 0]);
    check("bgra8", 4, &[3, 2, 1, 0, 6, 5, 4, 0]);
    assert_eq!(raw_color(&raw("mono8", 1, 1, 1, &[7])).unwrap().pixels, [[7, 7, 7]]);
}

#[test]
fn sixteen_bit_color_keeps_its_upper_bytes_and_other_names_are_refused() {
    let words = [1u8, 10, 2, 20, 3, 30];
    assert_eq!(raw_color(&raw("rgb16", 1, 1, 6, &words)).unwrap().pixels, [[10, 20, 30]]);
    assert_eq!(raw_color(&raw("bgr16", 1, 1, 6, &words)).unwrap().pixels, [[30, 20, 10]]);
    let wide = png(DynamicImage::new_rgb16(2, 2));
    assert_eq!(color_file(&wide).unwrap().pixels, [[0; 3]; 4]);
    let error = raw_color(&raw("h264", 1, 1, 6, &[0; 6])).unwrap_err();
    assert!(matches!(&error, ImageError::Encoding { .. }) && error.to_string().contains("h264"), "{error}");
}

#[test]
fn a_matrix_of_opencv_is_blue_green_red_and_a_missing_step_is_known() {
    assert_eq!(raw_color(&raw("8UC3", 1, 1, 3, &[3, 2, 1])).unwrap().pixels, [[1, 2, 3]]);
    assert_eq!(raw_color(&raw("RGB8", 1, 2, 0, &[1, 2, 3, 4, 5, 6])).unwrap().pixels, [[1, 2, 3], [4, 5, 6]]);
    assert_eq!(raw_color(&raw("rgba8", 2, 1, 4, &[1, 2, 3, 0, 4, 5, 6, 0])).unwrap().pixels.len(), 2);
}

#[test]
fn files_of_other_formats_and_depth_of_other_types_are_read() {
    let mut file = std::io::Cursor::new(Vec::new());
    DynamicImage::new_rgb8(3, 2).write_to(&mut file, ImageFormat::WebP).unwrap();
    assert_eq!(color_file(file.get_ref()).unwrap().width, 3);
    let tiff = color_file(b"II*\0").unwrap_err().to_string();
    assert!(tiff.contains("`TIFF` is not supported"), "{tiff}");
    let doubles: Vec<u8> = [1.5f64, f64::NAN].iter().flat_map(|v| v.to_le_bytes()).collect();
    assert_eq!(raw_depth(&raw("64FC1", 2, 1, 16, &doubles)).unwrap().pixels, [1.5, 0.0]);
    let words: Vec<u8> = [1000i16, -1].iter().flat_map(|v| v.to_le_bytes()).collect();
    assert_eq!(raw_depth(&raw("16SC1", 2, 1, 4, &words)).unwrap().pixels, [1.0, 0.0]);
}

#[test]
fn wrong_sizes_are_refused() {
    for image in [
        raw("rgb8", 2, 1, 3, &[0; 3]),
        raw("rgb8", 1, 2, 3, &[0; 5]),
        raw("rgb8", 0, 2, 3, &[]),
        raw("rgb8", 9000, 1, 27000, &[0; 27000]),
    ] {
        assert!(matches!(raw_color(&image), Err(ImageError::Broken(_))), "{}x{}", image.width, image.height);
    }
}

#[test]
fn depth_is_in_meters_whatever_the_byte_order() {
    let mut image = raw("16UC1", 2, 1, 4, &[0xe8, 0x03, 0, 0]);
    assert_eq!(raw_depth(&image).unwrap().pixels, [1.0, 0.0]);
    image.data = vec![0x03, 0xe8, 0, 0];
    image.is_bigendian = 1;
    assert_eq!(raw_depth(&image).unwrap().pixels, [1.0, 0.0]);
    let floats: Vec<u8> =
        [1.5f32, f32::NAN, f32::INFINITY, -1.0].iter().flat_map(|v| v.to_le_bytes()).collect();
    assert_eq!(raw_depth(&raw("32FC1", 4, 1, 16, &floats)).unwrap().pixels, [1.5, 0.0, 0.0, 0.0]);
    assert!(raw_depth(&raw("rgb8", 1, 1, 3, &[0; 3])).unwrap_err().to_string().contains("`rgb8`"));
}

#[test]
fn compressed_depth_as_png_and_rvl() {
    let values = [0u16, 1000, 1001, 65535];
    let expected = [0.0, 1.0, 1.001, 65.535f32];
    let close = |r: Raster<f32>| r.pixels.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-5);
    let code = depth_png(&values);
    for format in ["16UC1; compressedDepth png", "16UC1; compressedDepth"] {
        assert!(close(compressed_depth(&depth_message(format, 0.0, 0.0, &code)).unwrap()));
    }
    let code = [&4u32.to_le_bytes()[..], &1u32.to_le_bytes(), &rvl::encode(&values)].concat();
    assert!(close(compressed_depth(&depth_message("16UC1; compressedDepth rvl", 0.0, 0.0, &code)).unwrap()));
    let plain = CompressedImage {
        format: "16UC1; png compressed ".into(),
        data: depth_png(&values),
        ..CompressedImage::default()
    };
    assert!(close(compressed_depth(&plain).unwrap()));
}

#[test]
fn quantized_float_depth_follows_its_formula() {
    // depth = a / (q - b)
    let message = depth_message("32FC1; compressedDepth png", 1000.0, -500.0, &depth_png(&[0, 500, 1500]));
    assert_eq!(compressed_depth(&message).unwrap().pixels, [0.0, 1.0, 0.5]);
}

#[test]
fn broken_compressed_depth_is_an_error() {
    for (format, data) in [
        ("16UC1; compressedDepth png", &[0u8; 11][..]),
        ("16UC1; compressedDepth rvl", &[0; 16]),
        ("16UC1; compressedDepth png", &[0; 40]),
    ] {
        let message =
            CompressedImage { format: format.into(), data: data.to_vec(), ..CompressedImage::default() };
        assert!(matches!(compressed_depth(&message), Err(ImageError::Broken(_))));
    }
    let huge = [&8000u32.to_le_bytes()[..], &9000u32.to_le_bytes(), &[0; 8]].concat();
    assert!(matches!(
        compressed_depth(&depth_message("16UC1; compressedDepth rvl", 0.0, 0.0, &huge)),
        Err(ImageError::Broken(_))
    ));
}

#[test]
fn masks_and_alpha() {
    assert_eq!(raw_mask(&raw("mono8", 3, 1, 3, &[0, 1, 255])).unwrap().pixels, [false, true, true]);
    assert_eq!(raw_mask(&raw("mono16", 2, 1, 4, &[0, 0, 0, 1])).unwrap().pixels, [false, true]);
    let rgba = image::RgbaImage::from_raw(2, 1, vec![1, 2, 3, 255, 4, 5, 6, 0]).unwrap();
    let (color, alpha) = color_with_alpha_file(&png(DynamicImage::ImageRgba8(rgba))).unwrap();
    assert_eq!((color.pixels, alpha), (vec![[1, 2, 3], [4, 5, 6]], Some(vec![true, false])));
    assert!(mask_file(&[0xff, 0xd8, 0xff, 0]).unwrap_err().to_string().contains("JPEG"));
}

#[test]
fn nearest_resizing_keeps_values() {
    let small = Raster { width: 2, height: 1, pixels: vec![1u8, 2] };
    assert_eq!(small.resized_nearest(4, 2).pixels, [1, 1, 2, 2, 1, 1, 2, 2]);
    assert_eq!(small.resized_nearest(4, 2).resized_nearest(2, 1), small);
}
