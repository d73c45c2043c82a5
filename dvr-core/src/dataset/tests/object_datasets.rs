//! Datasets of many objects, read view by view.

use dvr_test_support::{scene, test_with};

use super::*;
use crate::files::write_rgba_png;
use crate::scene::Split;

/// Two categories with two objects each; the second has a list.
fn dataset() -> (Ball, tempfile::TempDir) {
    let (ball, folder) = (Ball::new(), tempfile::tempdir().unwrap());
    for object in ["balls/a", "balls/b", "02/c", "02/d"] {
        ball.write_dvr(&folder.path().join(object));
    }
    let write = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).unwrap();
    write("02/train.lst", "c\n");
    write("02/test.lst", "d\n");
    write("metadata.yaml", "'02':\n  id: '02'\n  name: spheres\n");
    (ball, folder)
}

fn open(folder: &tempfile::TempDir) -> ObjectDataset {
    ObjectDataset::open(folder.path(), ObjectOptions::default()).unwrap()
}

#[test]
fn a_view_reads_as_it_does_in_its_scene() {
    let (_, folder) = dataset();
    let objects = open(&folder);
    let scene = read(&folder.path().join("balls/b"));
    let b = objects.objects().iter().position(|object| object.name == "b").unwrap();
    assert_eq!(objects.views(b).unwrap(), scene.views.len());
    for (i, expected) in scene.views.iter().enumerate() {
        let view = objects.read_view(b, i).unwrap();
        assert_eq!((&view.name, &view.camera, &view.image), (&expected.name, &expected.camera, &expected.image));
        assert_eq!((view.mask, view.depth), (expected.mask.clone(), expected.depth.clone()));
    }
}

#[test]
fn objects_are_divided_by_lists_and_kept_by_category() {
    let (_, folder) = dataset();
    let objects = open(&folder);
    let names = |split| objects.of_split(split).iter().map(|&i| objects.objects()[i].name.as_str()).collect::<Vec<_>>();
    assert_eq!((names(Split::Train), names(Split::Test)), (vec!["c", "a", "b"], vec!["d"]));
    let of = |category: &str| ObjectOptions { categories: vec![category.to_owned()], ..ObjectOptions::default() };
    for category in ["02", "spheres"] {
        assert_eq!(ObjectDataset::open(folder.path(), of(category)).unwrap().objects().len(), 2);
    }
    let error = ObjectDataset::open(folder.path(), of("cubes")).err().unwrap().to_string();
    assert!(error.contains("`cubes`") && error.contains("balls, spheres"), "{error}");
    let empty = tempfile::tempdir().unwrap();
    assert!(ObjectDataset::open(empty.path(), ObjectOptions::default()).is_err());
}

#[test]
fn the_encoder_sees_the_object_on_white_from_wherever_its_pictures_are() {
    let (_, folder) = dataset();
    let objects = open(&folder);
    // A view, by its mask, padded from 48x36 to a square.
    assert_eq!(objects.inputs(0).unwrap(), 9);
    let input = objects.read_input(0, 0, 24).unwrap();
    let picture = input.image;
    assert_eq!((picture.dimensions(), picture.get_pixel(0, 0).0), ((24, 24), [255; 3]));
    assert!(picture.pixels().any(|pixel| pixel.0[0] < 200));

    // Pictures of 3D-R2N2 beside the views, with an alpha channel, or in a dataset of their own.
    let green = image::RgbaImage::from_pixel(20, 20, image::Rgba([0, 200, 0, 255]));
    let other = tempfile::tempdir().unwrap();
    for path in [folder.path().join("02/c/rendering"), other.path().join("02/c/rendering")] {
        std::fs::create_dir_all(&path).unwrap();
        write_rgba_png(&path.join("00.png"), &green).unwrap();
        std::fs::write(path.join("rendering_metadata.txt"), "").unwrap();
    }
    let options = ObjectOptions { inputs: Some(other.path().to_owned()), ..ObjectOptions::default() };
    let elsewhere = ObjectDataset::open(folder.path(), options).unwrap();
    for objects in [open(&folder), elsewhere] {
        let c = objects.objects().iter().position(|object| object.name == "c").unwrap();
        assert_eq!((objects.inputs(c).unwrap(), objects.views(c).unwrap()), (1, 9));
        assert_eq!(objects.read_input(c, 0, 20).unwrap().image.get_pixel(3, 3).0, [0, 200, 0]);
    }
}

#[test]
fn a_broken_object_harms_no_other() {
    let (_, folder) = dataset();
    std::fs::remove_file(folder.path().join("balls/a/cameras.npz")).unwrap();
    std::fs::write(folder.path().join("balls/b/image/0004.png"), "no picture").unwrap();
    std::fs::write(folder.path().join("balls/train.lst"), "a\nb\n").unwrap();
    let objects = open(&folder);
    let index = |name: &str| objects.objects().iter().position(|object| object.name == name).unwrap();
    assert!(objects.views(index("a")).unwrap_err().to_string().contains("cameras.npz"));
    assert!(objects.read_view(index("b"), 4).unwrap_err().to_string().contains("0004.png"));
    assert!(objects.read_view(index("b"), 3).is_ok() && objects.read_view(index("c"), 4).is_ok());
}

#[test_with(scene("shapenet_choy_car"))]
fn renders_of_3d_r2n2_are_inputs() {
    let (car, (_, folder)) = (scene("shapenet_choy_car/rendering"), dataset());
    let inputs = tempfile::tempdir().unwrap();
    for object in ["02/c", "02/d", "balls/a", "balls/b"] {
        let to = inputs.path().join(object).join("rendering");
        std::fs::create_dir_all(&to).unwrap();
        for name in ["00.png", "07.png", "rendering_metadata.txt"] {
            std::fs::copy(car.join(name), to.join(name)).unwrap();
        }
    }
    let options = ObjectOptions { inputs: Some(inputs.path().to_owned()), ..ObjectOptions::default() };
    let objects = ObjectDataset::open(folder.path(), options).unwrap();
    assert_eq!(objects.inputs(0).unwrap(), 2);
    assert!(objects.read_input(0, 1, 64).unwrap().camera.is_none(), "nobody says where it was taken from");
    let picture = objects.read_input(0, 1, 64).unwrap().image;
    let white = picture.pixels().filter(|pixel| pixel.0 == [255; 3]).count();
    assert_eq!(picture.get_pixel(0, 0).0, [255; 3]);
    assert!((500..3800).contains(&white), "{white} of 4096 pixels are white");
}
