//! Figures that come back from JSON whatever they are: it has no infinity, which is the PSNR of a perfect picture, and a
//! run that was resumed must not differ from one that was not.

use serde::{Deserialize, Deserializer, Serialize, Serializer};

use dvr_render::ViewMetrics;

/// PSNR and IoU as their bits, and the pixels.
type Bits = (u64, u64, usize);

pub(crate) fn serialize<S: Serializer>(view_metrics: &Option<ViewMetrics>, serializer: S) -> Result<S::Ok, S::Error> {
    let bits = view_metrics.map(|found| -> Bits { (found.psnr.to_bits(), found.mask_iou.to_bits(), found.pixels) });
    bits.serialize(serializer)
}

pub(crate) fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<ViewMetrics>, D::Error> {
    let bits = Option::<Bits>::deserialize(deserializer)?;
    Ok(bits.map(|(psnr, mask_iou, pixels)| ViewMetrics {
        psnr: f64::from_bits(psnr),
        mask_iou: f64::from_bits(mask_iou),
        pixels,
    }))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::growth::Reached;

    #[test]
    fn no_bit_is_lost_on_the_way_through_text() {
        for psnr in [183.0 / 7.0, f64::INFINITY, 1.0 / 3.0, 0.1 + 19.2] {
            let validation = Some(ViewMetrics { psnr, mask_iou: 0.1 + 0.2, pixels: 7 });
            let reached = Reached { cells: 32, parameters: 5, bytes: 6, validation };
            let text = serde_json::to_string(&reached).unwrap();
            assert_eq!(serde_json::from_str::<Reached>(&text).unwrap(), reached);
        }
    }
}
