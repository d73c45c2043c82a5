//! Configurations, results and curves.

use dvr_core::synth::SynthConfig;
use dvr_train::{Supervision, method_by_name};

pub(in crate::fuzz) fn config_json() -> Vec<Vec<u8>> {
    let methods = ["grid", "network", "objects"].map(|name| {
        let method = method_by_name(name, Supervision::Rgb).unwrap_or_else(|e| panic!("{e}"));
        method.config().unwrap_or_else(|e| panic!("{e}")).to_string().into_bytes()
    });
    let synth = serde_json::to_vec(&SynthConfig::default()).unwrap_or_else(|e| panic!("{e}"));
    methods.into_iter().chain([synth]).collect()
}

pub(in crate::fuzz) fn reference_yaml() -> Vec<Vec<u8>> {
    let scene = "method: dvr\ndata:\n  path: data/DTU\n  ignore_image_idx: [2, 12]\n  classes: ['scan118']\n  \
        depth_range: &range [0.5, 3.0]\n  n_views: 51\nmodel:\n  lambda_l1_rgb: 1.0\n  lambda_depth: 0.\n  \
        patch_size: 2\n  encoder: null\n  decoder_kwargs:\n    n_blocks: 5\n    hidden_size: 256\ntraining:\n  \
        out_dir: out\n  batch_size: 1\n  n_training_points: 2048\n  learning_rate: 1e-4\n  use_cube: *range\n";
    let objects = "model:\n  c_dim: 256\n  encoder: resnet18\n  lambda_depth: 10.0\n  lambda_rgb: 1\ntraining:\n  \
        scheduler_milestones: [100, 200]\n  depth_loss_on_world_points: true\n";
    [scene, objects].map(|text| text.as_bytes().to_vec()).into()
}

pub(in crate::fuzz) fn results_jsonl() -> Vec<Vec<u8>> {
    let head = r#"{"version":2,"predictor":"a","steps":3,"split":"test","seed":0,"resolution":32,"views":0}"#;
    let lost = r#"{"category":"a","category_name":"a","name":"b","problem":"no cameras"}"#;
    vec![format!("{head}\n").into_bytes(), format!("{head}\n{lost}\n").into_bytes()]
}

pub(in crate::fuzz) fn metrics_csv() -> Vec<Vec<u8>> {
    let text = "step,seconds,loss,mask_iou,learning_rate,samples,color,depth,held_out_psnr,chamfer_l1\n\
        10,0.5,2.0,0.8,1e-4,16,1.5,0,,\n20,1.0,1.0,0.9,1e-4,16,0.7,0,21.5,0.01\n";
    vec![text.as_bytes().to_vec()]
}
