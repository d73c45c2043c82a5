//! Digests change with everything that is read, wherever it lies.

use super::*;

fn digest(path: &Path) -> String {
    digest_of_scene(path, &ReadOptions::default(), None).unwrap().to_string()
}

#[test]
fn a_scene_is_the_same_until_a_byte_of_it_changes() {
    let folder = tempfile::tempdir().unwrap();
    let (one, two) = (folder.path().join("one"), folder.path().join("two"));
    let ball = Ball::new();
    ball.write_dvr(&one);
    ball.write_dvr(&two);
    let first = digest(&one);
    assert_eq!(digest(&two), first, "a copy is the same scene");
    assert_eq!(digest(&one.join("cameras.npz")), first, "by whatever file it is named");
    write_gray_png(&one.join("mask/0003.png"), &ball.mask(&ball.cameras[4]).coverage).unwrap();
    assert_ne!(digest(&one), first, "a mask");
}

#[test]
fn pictures_outside_of_the_folder_count() {
    let folder = tempfile::tempdir().unwrap();
    let (root, pictures) = (folder.path().join("scene"), folder.path().join("pictures"));
    let ball = Ball::new();
    let names = ball.write_images(&pictures, None);
    std::fs::create_dir(&root).unwrap();
    let frame = |(camera, name): (&Camera, &PathBuf)| ball.frame(camera, &format!("../pictures/{}", name.display()));
    let frames: Vec<_> = ball.cameras.iter().zip(&names).map(frame).collect();
    std::fs::write(root.join("transforms.json"), serde_json::json!({ "frames": frames }).to_string()).unwrap();
    let first = digest(&root);
    write_rgb_png(&pictures.join(&names[2]), &ball.image(&ball.cameras[3])).unwrap();
    assert_ne!(digest(&root), first);
}

#[test]
fn an_object_of_a_dataset_has_its_files_and_its_inputs() {
    let folder = tempfile::tempdir().unwrap();
    let ball = Ball::new();
    for object in ["data/balls/a", "inputs/balls/a"] {
        ball.write_dvr(&folder.path().join(object));
    }
    let options = ObjectOptions { inputs: Some(folder.path().join("inputs")), ..ObjectOptions::default() };
    let dataset = ObjectDataset::open(&folder.path().join("data"), options).unwrap();
    let first = dataset.digest(0).unwrap();
    assert_eq!(dataset.digest(0).unwrap(), first);
    for object in ["data/balls/a", "inputs/balls/a"] {
        let before = dataset.digest(0).unwrap();
        let picture = folder.path().join(object).join("image/0001.png");
        write_rgb_png(&picture, &ball.image(&ball.cameras[7])).unwrap();
        assert_ne!(dataset.digest(0).unwrap(), before, "{object}");
    }
}
