//! Sixteen sums side by side, held in one register where the processor has such wide ones, in two or four elsewhere.

/// How many.
pub const LANES: usize = 16;

/// As many values as stand side by side, from here on.
#[inline(always)]
pub fn lanes(values: &[f32], at: usize) -> Option<&[f32; LANES]> {
    values.get(at..at + LANES)?.first_chunk()
}

#[derive(Clone, Copy)]
#[repr(align(64))]
pub struct Lanes(pub [f32; LANES]);

impl Lanes {
    pub const ZERO: Lanes = Lanes([0.0; LANES]);

    #[inline(always)]
    pub fn plus_products(mut self, x: &[f32; LANES], y: &[f32; LANES]) -> Self {
        for l in 0..LANES {
            self.0[l] += x[l] * y[l];
        }
        self
    }

    /// Their sum: halves, quarters, ..., a fixed order that wide registers like.
    #[inline(always)]
    pub fn total(mut self) -> f32 {
        for half in [8, 4, 2, 1] {
            for l in 0..half {
                self.0[l] += self.0[l + half];
            }
        }
        self.0[0]
    }

    #[inline(always)]
    pub fn plus_times(mut self, x: &[f32; LANES], weight: f32) -> Self {
        for l in 0..LANES {
            self.0[l] += x[l] * weight;
        }
        self
    }
}
