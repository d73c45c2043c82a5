//! The configuration of a network, from the names and shapes of its tensors.

use super::file::{Tensors, matrix};
use crate::decoder::DecoderConfig;
use crate::encoder::EncoderConfig;
use crate::error::RecordError;

/// The configuration of a decoder, from the shapes of its tensors.
///
/// Tensors that the configuration makes large are compared with it here: a file that contradicts itself must not make
/// anybody allocate what it does not hold.
pub(super) fn decoder_config(tensors: &Tensors, prefix: &str, leaky: bool) -> Result<DecoderConfig, RecordError> {
    let [hidden, inputs] = matrix(tensors, &format!("{prefix}fc_p.weight"))?;
    if inputs != 3 {
        let name = format!("{prefix}fc_p.weight");
        return Err(RecordError::Shape { name, found: vec![hidden, inputs], expected: format!("[{hidden}, 3]") });
    }
    let blocks = (0..).take_while(|i| tensors.contains_key(&format!("{prefix}blocks.{i}.fc_0.weight"))).count();
    for i in 0..blocks {
        expect(tensors, &format!("{prefix}blocks.{i}.fc_0.weight"), [hidden, hidden])?;
    }
    let code = format!("{prefix}fc_c.0.weight");
    let code_dim = if tensors.contains_key(&code) { matrix(tensors, &code)?[1] } else { 0 };
    if code_dim > 0 {
        expect(tensors, &code, [hidden, code_dim])?;
    }
    Ok(DecoderConfig::new().with_code_dim(code_dim).with_hidden(hidden).with_blocks(blocks).with_leaky(leaky))
}

/// The configuration of an encoder that makes codes of some length, from the names and shapes of its tensors.
pub(super) fn encoder_config(tensors: &Tensors, code_dim: usize) -> Result<EncoderConfig, RecordError> {
    let image_size = EncoderConfig::default().image_size().unwrap_or_default();
    if let Some(first) = tensors.get("encoder.conv0.weight") {
        let width = first.shape.first().copied().unwrap_or(0);
        expect(tensors, "encoder.fc_out.weight", [code_dim, width.saturating_mul(16)])?;
        return Ok(EncoderConfig::Convolutional { image_size, width });
    }
    if tensors.contains_key("encoder.weight") {
        let [objects, _] = matrix(tensors, "encoder.weight")?;
        expect(tensors, "encoder.weight", [objects, code_dim])?;
        return Ok(EncoderConfig::Codes { objects });
    }
    check_is_resnet18(tensors, "encoder.features.")?;
    Ok(EncoderConfig::Resnet18 { image_size })
}

/// Checks the extents of a matrix.
fn expect(tensors: &Tensors, name: &str, extents: [usize; 2]) -> Result<(), RecordError> {
    let found = matrix(tensors, name)?;
    if found == extents {
        return Ok(());
    }
    Err(RecordError::Shape { name: name.to_owned(), found: found.to_vec(), expected: format!("{extents:?}") })
}

/// Distinguishes a ResNet-18 from its larger relatives, whose names are a superset of its own.
pub(super) fn check_is_resnet18(tensors: &Tensors, prefix: &str) -> Result<(), RecordError> {
    let has = |name: &str| tensors.contains_key(&format!("{prefix}{name}"));
    if has("layer1.0.conv3.weight") || has("layer1.2.conv1.weight") {
        return Err(RecordError::Architecture {
            found: "the encoder is a larger ResNet".into(),
            expected: "ResNet-18",
        });
    }
    if !has("layer1.0.conv1.weight") {
        let first = tensors.keys().filter(|name| name.starts_with("encoder.")).min().or(tensors.keys().min());
        let first = first.map_or("nothing", |name| name.as_str());
        return Err(RecordError::Architecture {
            found: format!("an encoder whose tensors begin with {first:?}"),
            expected: "ResNet-18, five convolutions or a table of codes",
        });
    }
    Ok(())
}
