//! COLMAP's sparse models, as text and in binary.

use std::path::Path;

use glam::DQuat;

use super::*;
use crate::dataset::layouts::find_views;
use crate::verified_points::VerifiedPoints;

/// A COLMAP model: camera 7 for every second image, 3 for the others; three points.
struct ColmapBall<'a> {
    ball: &'a Ball,
    points: [(DVec3, [u8; 3], Vec<u32>); 3],
}

impl<'a> ColmapBall<'a> {
    fn new(ball: &'a Ball) -> Self {
        let seen = |point: DVec3| {
            let on_ball = |camera: &Camera| {
                let (pixel, z) = camera.project(point);
                ball.z_depth(camera, pixel).is_some_and(|near| (near - z).abs() < 1e-6)
            };
            (0..9u32).filter(|&i| on_ball(&ball.cameras[i as usize])).map(|i| 100 - i).collect::<Vec<u32>>()
        };
        let front = |i: usize, side: f64| {
            let camera = &ball.cameras[i];
            let pixel = camera.project(ball.center).0 + DVec2::new(side, 2.0);
            camera.ray(pixel).at(ball.z_depth(camera, pixel).unwrap())
        };
        let (a, b) = (front(2, 3.0), front(5, -4.0));
        let floor = ball.center - DVec3::Y * 3.0 * ball.radius;
        Self { ball, points: [(a, [255, 0, 51], seen(a)), (b, [1, 2, 3], seen(b)), (floor, [9; 3], vec![100, 99])] }
    }

    /// Image ids count down while names count up: order must not matter.
    fn images(&self) -> impl Iterator<Item = (u32, DQuat, &Camera, String)> {
        self.ball
            .cameras
            .iter()
            .enumerate()
            .map(|(i, camera)| (100 - i as u32, DQuat::from_mat3(&camera.rotation), camera, format!("{i:04}.png")))
    }

    /// The features of an image, in pixels with the index of a point: some of no point, then those of points, in order.
    fn features(&self, id: u32) -> Vec<(DVec2, i64)> {
        let camera = &self.ball.cameras[100 - id as usize];
        let of_none = (0..id % 3).map(|i| (DVec2::new(f64::from(i), 2.5), -1));
        let seen = self.points.iter().enumerate().filter(|(_, (_, _, track))| track.contains(&id));
        of_none.chain(seen.map(|(index, (point, _, _))| (camera.project(*point).0, index as i64))).collect()
    }

    /// Which feature of an image shows a point.
    fn feature_of(&self, id: u32, point: usize) -> u32 {
        self.features(id).iter().position(|&(_, index)| index == point as i64).unwrap() as u32
    }

    fn write_text(&self, folder: &Path) {
        std::fs::create_dir_all(folder).unwrap();
        let mut cameras = "# Camera list\n".to_owned();
        let mut images = "# Image list\n# with two lines an image\n".to_owned();
        for (id, q, camera, name) in self.images() {
            let k = camera.intrinsics;
            cameras +=
                &format!("{id} PINHOLE {WIDTH} {HEIGHT} {} {} {} {}\n", k.x_axis.x, k.y_axis.y, k.z_axis.x, k.z_axis.y);
            let t = camera.translation;
            let features: Vec<String> =
                self.features(id).iter().map(|(pixel, index)| format!("{} {} {index}", pixel.x, pixel.y)).collect();
            let features = features.join(" ");
            images +=
                &format!("{id} {} {} {} {} {} {} {} {id} {name}\n{features}\n", q.w, q.x, q.y, q.z, t.x, t.y, t.z);
        }
        let mut points = "# Points\n".to_owned();
        for (i, (p, [r, g, b], track)) in self.points.iter().enumerate() {
            points += &format!("{i} {} {} {} {r} {g} {b} 0.5", p.x, p.y, p.z);
            track.iter().for_each(|id| points += &format!(" {id} {}", self.feature_of(*id, i)));
            points += "\n";
        }
        std::fs::write(folder.join("cameras.txt"), cameras).unwrap();
        std::fs::write(folder.join("images.txt"), images).unwrap();
        std::fs::write(folder.join("points3D.txt"), points).unwrap();
    }

    fn write_binary(&self, folder: &Path) {
        std::fs::create_dir_all(folder).unwrap();
        let count = (self.ball.cameras.len() as u64).to_le_bytes();
        let (mut cameras, mut images) = (count.to_vec(), count.to_vec());
        let floats = |out: &mut Vec<u8>, values: &[f64]| values.iter().for_each(|x| out.extend(x.to_le_bytes()));
        for (id, q, camera, name) in self.images() {
            let k = camera.intrinsics;
            cameras.extend(id.to_le_bytes());
            cameras.extend(1i32.to_le_bytes());
            cameras.extend(u64::from(WIDTH).to_le_bytes());
            cameras.extend(u64::from(HEIGHT).to_le_bytes());
            floats(&mut cameras, &[k.x_axis.x, k.y_axis.y, k.z_axis.x, k.z_axis.y]);
            images.extend(id.to_le_bytes());
            floats(&mut images, &[q.w, q.x, q.y, q.z]);
            floats(&mut images, &camera.translation.to_array());
            images.extend(id.to_le_bytes());
            images.extend(name.as_bytes());
            images.push(0);
            let features = self.features(id);
            images.extend((features.len() as u64).to_le_bytes());
            for (pixel, index) in features {
                floats(&mut images, &pixel.to_array());
                images.extend(index.to_le_bytes());
            }
        }
        let mut points = (self.points.len() as u64).to_le_bytes().to_vec();
        for (i, (p, color, track)) in self.points.iter().enumerate() {
            points.extend((i as u64).to_le_bytes());
            floats(&mut points, &p.to_array());
            points.extend(color);
            floats(&mut points, &[0.5]);
            points.extend((track.len() as u64).to_le_bytes());
            for id in track {
                points.extend([id.to_le_bytes(), self.feature_of(*id, i).to_le_bytes()].concat());
            }
        }
        std::fs::write(folder.join("cameras.bin"), cameras).unwrap();
        std::fs::write(folder.join("images.bin"), images).unwrap();
        std::fs::write(folder.join("points3D.bin"), points).unwrap();
    }

    fn assert_reads(&self, path: &Path) {
        let scene = read(path);
        assert_eq!(scene.format, "COLMAP");
        self.ball.assert_same_cameras(&scene);
        self.ball.assert_in_cube(&scene);
        let sparse = scene.sparse_points.unwrap();
        assert_eq!(sparse.cloud.points.len(), 2, "the floor is not the object");
        for (i, (world, _, track)) in self.points[..2].iter().enumerate() {
            let back = scene.object_to_world.transform_point(sparse.cloud.points[i].as_dvec3());
            assert!((back - *world).length() < 1e-3);
            assert_eq!(sparse.visible_in[i], track.iter().map(|id| 100 - *id as usize).collect::<Vec<_>>());
        }
        assert_eq!(sparse.cloud.colors.as_ref().unwrap()[0], [1.0, 0.0, 0.2]);
        assert_eq!(sparse.errors_px, Some(vec![0.5; 2]));
        // The pictures show the points where their cameras do.
        for (i, (world, _, _)) in self.points[..2].iter().enumerate() {
            for (&view, bearing) in sparse.visible_in[i].iter().zip(&sparse.bearings.as_ref().unwrap()[i]) {
                let camera = &self.ball.cameras[view];
                let p = camera.rotation * *world + camera.translation;
                assert!((*bearing - DVec2::new(p.x, p.y) / p.z).length() < 1e-6, "{bearing}");
            }
        }
    }
}

#[test]
fn colmap_models_read_as_text_and_binary_and_wherever_they_lie() {
    let ball = Ball::new();
    let colmap = ColmapBall::new(&ball);
    for (model, binary) in [("sparse/0", true), ("sparse/0", false), ("sparse", true), (".", false)] {
        let folder = tempfile::tempdir().unwrap();
        let root = folder.path();
        let names = ball.write_images(&root.join("images"), Some(&root.join("masks")));
        if binary {
            // COLMAP's own way to name masks.
            for name in &names {
                let mask = root.join("masks").join(name);
                std::fs::rename(&mask, mask.with_extension("png.png")).unwrap();
            }
            colmap.write_binary(&root.join(model));
        } else {
            colmap.write_text(&root.join(model));
        }
        colmap.assert_reads(root);
        colmap.assert_reads(&root.join(model));
    }
}

#[test]
fn a_truncated_colmap_model_is_refused_wherever_it_ends() {
    let (ball, folder) = (Ball::new(), tempfile::tempdir().unwrap());
    let root = folder.path();
    ball.write_images(&root.join("images"), Some(&root.join("masks")));
    ColmapBall::new(&ball).write_binary(&root.join("sparse/0"));
    for file in ["cameras.bin", "images.bin", "points3D.bin"] {
        let path = root.join("sparse/0").join(file);
        let bytes = std::fs::read(&path).unwrap();
        for length in 0..bytes.len() {
            std::fs::write(&path, &bytes[..length]).unwrap();
            let error = find_views("colmap".parse().unwrap(), root, &ReadOptions::default())
                .err()
                .map(|error| error.to_string())
                .unwrap_or_default();
            assert!(error.contains(file) && error.contains("ends too early"), "{length} bytes: {error}");
        }
        std::fs::write(&path, &bytes).unwrap();
    }
}

#[test]
fn a_colmap_camera_that_is_none_is_refused_by_its_number() {
    let (ball, folder) = (Ball::new(), tempfile::tempdir().unwrap());
    let root = folder.path();
    ball.write_images(&root.join("images"), Some(&root.join("masks")));
    ColmapBall::new(&ball).write_text(&root.join("sparse/0"));
    let path = root.join("sparse/0/cameras.txt");
    let text = std::fs::read_to_string(&path).unwrap();
    for (model, words) in [("OPENCV", "OPENCV has 4 parameters, not 8"), ("KANNALA", "KANNALA is not known")] {
        std::fs::write(&path, text.replacen("PINHOLE", model, 1)).unwrap();
        let error = read_scene(root, &ReadOptions::default()).unwrap_err().to_string();
        assert!(error.contains("camera 100") && error.contains(words), "{error}");
    }
    std::fs::write(&path, &text[..text.len() / 2]).unwrap();
    let error = read_scene(root, &ReadOptions::default()).unwrap_err().to_string();
    assert!(
        error.contains("cameras.txt: line ") || error.contains("parameters") || error.contains("does not exist"),
        "{error}"
    );
}

#[test]
fn the_points_of_a_model_come_with_their_tracks_where_its_other_files_lie_beside() {
    let (ball, folder) = (Ball::new(), tempfile::tempdir().unwrap());
    let colmap = ColmapBall::new(&ball);
    colmap.write_binary(&folder.path().join("bin"));
    colmap.write_text(&folder.path().join("txt"));
    for kind in ["bin", "txt"] {
        let file = folder.path().join(kind).join(format!("points3D.{kind}"));
        let points = VerifiedPoints::read(&file).unwrap();
        assert_eq!(points.points.len(), 3);
        assert!((points.points[1] - colmap.points[1].0).length() < 1e-9);
        let lengths: Vec<usize> = colmap.points.iter().map(|(_, _, track)| track.len()).collect();
        assert_eq!((points.track_lengths.unwrap(), points.errors_px), (lengths, Some(vec![0.5; 3])));
        let tracks = points.tracks.unwrap();
        for (sights, (point, _, _)) in tracks.sights.iter().zip(&colmap.points) {
            for sight in sights {
                let camera = &tracks.cameras[sight.camera];
                let p = camera.rotation * *point + camera.translation;
                assert!((sight.bearing.unwrap() - DVec2::new(p.x, p.y) / p.z).length() < 1e-6);
            }
        }
        std::fs::remove_file(folder.path().join(kind).join(format!("images.{kind}"))).unwrap();
        let bare = VerifiedPoints::read(&file).unwrap();
        assert_eq!((bare.points, bare.tracks), (points.points, None));
    }
}
