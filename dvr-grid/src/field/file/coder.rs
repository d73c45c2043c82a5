//! Bits with adaptive probabilities, range coded (Martin 1979; the coder itself is `constriction`'s).
//!
//! What is coded is written once for both directions: a [`Coder`] that writes codes what it is given and hands it back,
//! one that reads ignores what it is given and hands back what was written.

use std::borrow::Borrow;
use std::convert::Infallible;
use std::num::NonZeroU32;

use constriction::Queue;
use constriction::backends::ReadWords;
use constriction::stream::model::{DecoderModel, EncoderModel, EntropyModel};
use constriction::stream::queue::{RangeDecoder, RangeEncoder};
use constriction::stream::{Decode, Encode};

/// Bits of a probability.
const PRECISION: usize = 16;

/// Bits that a probability is kept with beside: a pace of a hundredth rounds to nothing without.
const FINER: usize = 6;

/// The probability 1, as it is kept.
const ALL: i32 = 1 << (PRECISION + FINER);

/// The least probability, of 1 << 16: a bit that is sure costs next to nothing, one that is sure and wrong 12 bits.
const LEAST: u32 = 16;

/// Bits after which a probability follows at a constant pace.
const MEMORY: u8 = 160;

/// Words of 32 bits that a reader may ask for beyond the end of what was written.
const BEYOND: usize = 2;

/// What is known of a bit from those before it in its place.
#[derive(Clone, Copy, Debug)]
pub(super) struct BitModel {
    /// Probability of 1, of [`ALL`].
    one: i32,
    /// Bits that were seen, as far as they count.
    seen: u8,
}

impl Default for BitModel {
    fn default() -> Self {
        Self { one: ALL / 2, seen: 0 }
    }
}

impl BitModel {
    fn learn(&mut self, bit: bool) {
        let target = if bit { ALL } else { 0 };
        self.one += 2 * (target - self.one) / (2 * i32::from(self.seen) + 3);
        self.seen = (self.seen + 1).min(MEMORY);
    }

    fn share(self, bit: bool) -> (u32, NonZeroU32) {
        let one = ((self.one as u32) >> FINER).clamp(LEAST, (1 << PRECISION) - LEAST);
        let zero = (1 << PRECISION) - one;
        let (from, width) = if bit { (zero, one) } else { (0, zero) };
        (from, NonZeroU32::new(width).unwrap_or(NonZeroU32::MIN))
    }
}

impl EntropyModel<PRECISION> for BitModel {
    type Symbol = bool;
    type Probability = u32;
}

impl EncoderModel<PRECISION> for BitModel {
    fn left_cumulative_and_probability(&self, symbol: impl Borrow<bool>) -> Option<(u32, NonZeroU32)> {
        Some(self.share(*symbol.borrow()))
    }
}

impl DecoderModel<PRECISION> for BitModel {
    fn quantile_function(&self, quantile: u32) -> (bool, u32, NonZeroU32) {
        let bit = quantile >= self.share(true).0;
        let (from, width) = self.share(bit);
        (bit, from, width)
    }
}

/// Writes bits, or reads them.
pub(super) trait Coder {
    /// Codes a bit whose probability is that of `model`, which learns it. A reader ignores `given`.
    fn bit(&mut self, model: &mut BitModel, given: bool) -> bool;

    /// Whether more was read than was written, or what no writer writes: nothing that is coded now is worth anything.
    fn is_broken(&self) -> bool {
        false
    }
}

/// Writes bits.
#[derive(Default)]
pub(super) struct Writer(RangeEncoder<u32, u64>);

impl Writer {
    /// What was written.
    pub fn finish(self) -> Vec<u8> {
        let words = self.0.into_compressed().unwrap_or_else(|never: Infallible| match never {});
        words.into_iter().flat_map(u32::to_le_bytes).collect()
    }
}

impl Coder for Writer {
    fn bit(&mut self, model: &mut BitModel, given: bool) -> bool {
        let written = self.0.encode_symbol(given, *model);
        debug_assert!(written.is_ok(), "no bit is impossible");
        model.learn(given);
        given
    }
}

/// More was asked for than was written.
#[derive(Debug)]
struct CutShort;

/// Words of 32 bits, and how often more was asked for than there are.
struct Words<'a> {
    rest: std::slice::Iter<'a, [u8; 4]>,
    beyond: usize,
}

impl ReadWords<u32, Queue> for Words<'_> {
    type ReadError = CutShort;

    fn read(&mut self) -> Result<Option<u32>, CutShort> {
        let next = self.rest.next().map(|&word| u32::from_le_bytes(word));
        self.beyond += usize::from(next.is_none());
        if self.beyond > BEYOND { Err(CutShort) } else { Ok(next) }
    }
}

/// Reads bits.
pub(super) struct Reader<'a> {
    /// None once more was asked for than there is.
    decoder: Option<RangeDecoder<u32, u64, Words<'a>>>,
}

impl<'a> Reader<'a> {
    /// Of what a [`Writer`] wrote.
    pub fn new(bytes: &'a [u8]) -> Self {
        let words = Words { rest: bytes.as_chunks::<4>().0.iter(), beyond: 0 };
        Self { decoder: RangeDecoder::with_backend(words).ok() }
    }

    /// Whether all was read that there is.
    pub fn ends_here(self) -> bool {
        self.decoder.is_some_and(|decoder| decoder.into_raw_parts().0.rest.len() == 0)
    }
}

impl Coder for Reader<'_> {
    fn bit(&mut self, model: &mut BitModel, _: bool) -> bool {
        match self.decoder.as_mut().map(|decoder| decoder.decode_symbol(*model)) {
            Some(Ok(bit)) => {
                model.learn(bit);
                bit
            }
            _ => {
                self.decoder = None;
                false
            }
        }
    }

    fn is_broken(&self) -> bool {
        self.decoder.is_none()
    }
}

/// Steps of a size that are coded one by one.
const ONE_BY_ONE: usize = 18;

/// Bits of what is left of a size then.
const LEFT_BITS: usize = 8;

/// What is known of a whole number.
#[derive(Clone, Debug, Default)]
pub(super) struct NumberModel {
    is_not_zero: BitModel,
    is_negative: BitModel,
    /// Whether it is further from zero than so many steps, below and above.
    is_larger: [[BitModel; ONE_BY_ONE]; 2],
    left: [BitModel; LEFT_BITS],
}

impl NumberModel {
    /// Codes a number whose size is below 256. A reader ignores `given`.
    pub fn code(&mut self, coder: &mut impl Coder, given: i32) -> i32 {
        if !coder.bit(&mut self.is_not_zero, given != 0) {
            return 0;
        }
        let is_negative = coder.bit(&mut self.is_negative, given < 0);
        let (size, mut found) = (given.unsigned_abs() as usize, 1);
        for is_larger in &mut self.is_larger[usize::from(is_negative)] {
            if !coder.bit(is_larger, size > found) {
                return if is_negative { -(found as i32) } else { found as i32 };
            }
            found += 1;
        }
        let given_left = size.saturating_sub(found);
        for (bit, model) in self.left.iter_mut().enumerate() {
            found += usize::from(coder.bit(model, given_left >> bit & 1 == 1)) << bit;
        }
        if is_negative { -(found as i32) } else { found as i32 }
    }
}

#[cfg(test)]
mod tests {
    use rand::{Rng, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;

    /// Numbers and bits, one after the other.
    fn coded(coder: &mut impl Coder, given: &[(i32, bool)]) -> Vec<(i32, bool)> {
        let (mut number, mut bit) = (NumberModel::default(), BitModel::default());
        given.iter().map(|&(n, b)| (number.code(coder, n), coder.bit(&mut bit, b))).collect()
    }

    #[test]
    fn what_is_written_is_read_and_what_is_likely_costs_little() {
        let mut rng = ChaCha8Rng::seed_from_u64(3);
        let numbers: Vec<i32> = (0..4000)
            .map(|i| if i % 100 == 0 { rng.random_range(-255..=255) } else { rng.random_range(-1..=1) })
            .collect();
        let bits: Vec<bool> = (0..4000).map(|_| rng.random_bool(0.01)).collect();
        let mut writer = Writer::default();
        let given: Vec<_> = numbers.into_iter().zip(bits).collect();
        assert_eq!(coded(&mut writer, &given), given);
        let bytes = writer.finish();
        // log2(3) bits for a number, .08 for a bit, and a few that are large.
        assert!(bytes.len() < 4000 * 19 / 80, "{} bytes", bytes.len());
        let mut reader = Reader::new(&bytes);
        assert_eq!(coded(&mut reader, &vec![(0, false); given.len()]), given);
        assert!(!reader.is_broken() && reader.ends_here());
    }

    #[test]
    fn what_is_not_there_is_noticed() {
        let mut reader = Reader::new(&[]);
        let mut rng = ChaCha8Rng::seed_from_u64(4);
        // Bits that are as likely as not cost one each.
        (0..200).for_each(|_| {
            reader.bit(&mut BitModel::default(), rng.random());
        });
        assert!(reader.is_broken());
    }
}
