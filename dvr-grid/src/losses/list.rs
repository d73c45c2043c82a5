//! The macro that turns the list of loss terms into code.

/// See [`crate::losses`].
macro_rules! loss_terms {
    (
        appearance { $($appearance:ident: $Appearance:ident,)* }
        cross_view { $($cross:ident: $Cross:ident,)* }
        geometry { $($geometry:ident: $Geometry:ident,)* }
        silhouette { $($silhouette:ident: $Silhouette:ident,)* }
        nodes { $($node:ident: $Node:ident,)* }
    ) => {
        loss_structs! {
            rays {
                $($appearance: $Appearance,)*
                $($cross: $Cross,)*
                $($geometry: $Geometry,)*
                $($silhouette: $Silhouette,)*
            }
            nodes { $($node: $Node,)* }
        }

        impl GridLosses {
            /// The terms of a hit that speak of its colour.
            pub(crate) fn appearance(&self, hit: &SurfaceHit, gradient: &mut SurfaceGradient, sums: &mut LossSums) {
                $(if self.$appearance.weight() > 0.0 {
                    sums.$appearance += SurfaceTerm::evaluate(&self.$appearance, hit, gradient);
                })*
            }

            /// The terms of a hit that speak of where it lies.
            pub(crate) fn geometry(&self, hit: &SurfaceHit, gradient: &mut SurfaceGradient, sums: &mut LossSums) {
                $(if self.$geometry.weight() > 0.0 {
                    sums.$geometry += SurfaceTerm::evaluate(&self.$geometry, hit, gradient);
                })*
            }

            /// Whether hits are compared with other views.
            pub(crate) fn has_cross_view(&self) -> bool {
                false $(|| self.$cross.weight() > 0.0)*
            }

            /// The terms of a hit that compare it with other views; returns the sum of their gradients by the depth.
            pub(crate) fn cross_view<'a>(
                &self,
                own: &TrainingView,
                hit: &SurfaceHit,
                others: impl Iterator<Item = Comparison<'a>>,
                sums: &mut LossSums,
            ) -> f32 {
                $(let $cross = (self.$cross.weight() > 0.0).then(|| self.$cross.prepare(own, hit)).flatten();)*
                let mut grad_depth = 0.0;
                for other in others {
                    $(if let Some(prepared) = &$cross {
                        sums.$cross += self.$cross.compare(prepared, hit, &other, &mut grad_depth);
                    })*
                }
                grad_depth
            }

            /// The terms of a ray whose hit and mask do not agree; returns the gradient by the largest value.
            pub(crate) fn silhouette(&self, largest: f32, sign: f32, sums: &mut LossSums) -> f32 {
                let mut grad_value = 0.0;
                $(if self.$silhouette.weight() > 0.0 {
                    let (value, gradient) = SilhouetteTerm::evaluate(&self.$silhouette, largest, sign);
                    sums.$silhouette += value;
                    grad_value += gradient;
                })*
                grad_value
            }

            /// Names of the terms that are means over other views.
            #[cfg(test)]
            pub(crate) const CROSS_VIEW: &[&str] = &[$(stringify!($cross)),*];

            /// Name and weighted mean of each term, in the order of the list.
            pub(crate) fn weighted(
                &self,
                sums: &LossSums,
                rays: usize,
                compared_views: usize,
            ) -> Vec<(&'static str, f64)> {
                let (mean, compared_views) = (1.0 / rays as f64, compared_views.max(1) as f64);
                vec![
                    $((stringify!($appearance), self.$appearance.weight() * sums.$appearance * mean),)*
                    $((stringify!($cross), self.$cross.weight() * sums.$cross * mean / compared_views),)*
                    $((stringify!($geometry), self.$geometry.weight() * sums.$geometry * mean),)*
                    $((stringify!($silhouette), self.$silhouette.weight() * sums.$silhouette * mean),)*
                    $((stringify!($node), self.$node.weight() * sums.$node),)*
                ]
            }
        }

        /// The terms inside kernels. Each writes its value to its place of [`RayLosses`] from `at` on.
        #[cfg(feature = "gpu")]
        pub(crate) mod gpu {
            #![allow(missing_docs)]
            #![allow(dead_code, reason = "launch arguments are made by name, not by the derived function")]

            use std::mem::offset_of;

            use cubecl::prelude::*;

            use super::term::gpu::{PixelRay, SurfaceGradient, SurfaceHit};
            use super::{GridLosses, RayLosses};
            use crate::gpu::views::{Photo, Seen};

            /// The numbers of all terms of rays.
            #[derive(CubeLaunch, CubeType, Clone, Copy)]
            pub(crate) struct Weights {
                $(pub $appearance: crate::losses::$appearance::gpu::Weights,)*
                $(pub $cross: crate::losses::$cross::gpu::Weights,)*
                $(pub $geometry: crate::losses::$geometry::gpu::Weights,)*
                $(pub $silhouette: crate::losses::$silhouette::gpu::Weights,)*
            }

            impl GridLosses {
                pub(crate) fn launch(&self) -> WeightsLaunch {
                    WeightsLaunch {
                        $($appearance: self.$appearance.launch(),)*
                        $($cross: self.$cross.launch(),)*
                        $($geometry: self.$geometry.launch(),)*
                        $($silhouette: self.$silhouette.launch(),)*
                    }
                }
            }

            /// What is the same for all views that a hit is compared with.
            #[derive(CubeType)]
            pub(crate) struct Prepared {
                $($cross: crate::losses::$cross::gpu::Prepared,)*
            }

            #[cube]
            pub(crate) fn appearance(
                weights: &Weights,
                pixel: &PixelRay,
                hit: &SurfaceHit,
                gradient: &SurfaceGradient,
                record: &mut [f32],
                at: usize,
            ) {
                $(if weights.$appearance.weight > 0.0f32 {
                    let value = crate::losses::$appearance::gpu::evaluate(&weights.$appearance, pixel, hit, gradient);
                    record[at + comptime!(offset_of!(RayLosses, $appearance) / 4)] = value;
                })*
            }

            #[cube]
            pub(crate) fn geometry(
                weights: &Weights,
                pixel: &PixelRay,
                hit: &SurfaceHit,
                gradient: &SurfaceGradient,
                record: &mut [f32],
                at: usize,
            ) {
                $(if weights.$geometry.weight > 0.0f32 {
                    let value = crate::losses::$geometry::gpu::evaluate(&weights.$geometry, pixel, hit, gradient);
                    record[at + comptime!(offset_of!(RayLosses, $geometry) / 4)] = value;
                })*
            }

            #[cube]
            pub(crate) fn has_cross_view(weights: &Weights) -> bool {
                let mut has = false;
                $(has = has || weights.$cross.weight > 0.0f32;)*
                has
            }

            #[cube]
            pub(crate) fn prepare_cross_view(
                weights: &Weights,
                views: &[u32],
                pixels: &[u32],
                pixel: &PixelRay,
                hit: &SurfaceHit,
            ) -> Prepared {
                Prepared {
                    $($cross: crate::losses::$cross::gpu::prepare(&weights.$cross, views, pixels, pixel, hit),)*
                }
            }

            #[cube]
            pub(crate) fn cross_view(
                weights: &Weights,
                prepared: &Prepared,
                views: &[u32],
                pixels: &[u32],
                pixel: &PixelRay,
                other: &Photo,
                seen: &Seen,
                grad_depth: &RuntimeCell<f32>,
                record: &mut [f32],
                at: usize,
            ) {
                $(
                    let value = crate::losses::$cross::gpu::compare(
                        &weights.$cross, &prepared.$cross, views, pixels, pixel, other, seen, grad_depth,
                    );
                    record[at + comptime!(offset_of!(RayLosses, $cross) / 4)] += value;
                )*
            }

            /// Returns the gradient by the largest value.
            #[cube]
            pub(crate) fn silhouette(
                weights: &Weights,
                largest: f32,
                sign: f32,
                record: &mut [f32],
                at: usize,
            ) -> f32 {
                let grad_value = RuntimeCell::<f32>::new(0.0f32);
                $(if weights.$silhouette.weight > 0.0f32 {
                    let value = crate::losses::$silhouette::gpu::evaluate(&weights.$silhouette, largest, sign, &grad_value);
                    record[at + comptime!(offset_of!(RayLosses, $silhouette) / 4)] = value;
                })*
                grad_value.read()
            }
        }
    };
}

/// The structs with a field per term.
macro_rules! loss_structs {
    (
        rays { $($ray:ident: $Ray:ident,)* }
        nodes { $($node:ident: $Node:ident,)* }
    ) => {
        /// Names of the terms: keys of the configuration, and of [`crate::StepReport::terms`], in this order.
        pub const NAMES: &[&str] = &[$(stringify!($ray),)* $(stringify!($node),)*];

        /// The terms of the loss, with their weights and other numbers.
        #[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
        #[serde(deny_unknown_fields, default)]
        #[allow(missing_docs, reason = "each term's struct says what it is")]
        pub struct GridLosses {
            $(pub $ray: $Ray,)*
            $(pub $node: $Node,)*
        }

        /// Values of the terms without their weights, summed over the rays of a step (and the views compared with);
        /// terms of nodes are means.
        #[derive(Clone, Copy, Debug, Default, PartialEq)]
        pub(crate) struct LossSums {
            $(pub $ray: f64,)*
            $(pub $node: f64,)*
            /// Rays that hit and show the object.
            pub intersection: usize,
            /// Rays that do either.
            pub union: usize,
        }

        /// Values of the terms of one ray, as a GPU writes them down.
        #[derive(Clone, Copy, Debug, Default, PartialEq)]
        #[cfg_attr(feature = "gpu", derive(bytemuck::Pod, bytemuck::Zeroable))]
        #[cfg(any(test, feature = "gpu"))]
        #[repr(C)]
        pub(crate) struct RayLosses {
            $(pub $ray: f32,)*
        }

        impl LossSums {
            /// Adds the sums of other rays.
            pub fn add(&mut self, other: &Self) {
                $(self.$ray += other.$ray;)*
                self.intersection += other.intersection;
                self.union += other.union;
            }

            /// Adds a ray.
            #[cfg(feature = "gpu")]
            pub fn add_ray(&mut self, ray: &RayLosses) {
                $(self.$ray += f64::from(ray.$ray);)*
            }

            /// The sums over one ray as a GPU writes them down.
            #[cfg(test)]
            pub fn of_ray(&self) -> RayLosses {
                RayLosses { $($ray: self.$ray as f32,)* }
            }
        }

        impl GridLosses {
            /// The ranges of all numbers.
            pub(crate) fn ranges() -> Vec<NumberRange> {
                let losses = Self::default();
                [
                    $(ranges(stringify!($ray), &losses.$ray),)*
                    $(ranges(stringify!($node), &losses.$node),)*
                ]
                .concat()
            }

            /// All weights zero.
            #[cfg(test)]
            pub(crate) fn none() -> Self {
                let mut losses = Self::default();
                $(losses.$ray.weight = 0.0;)*
                $(losses.$node.weight = 0.0;)*
                losses
            }

            /// All terms, as tests compare them.
            #[cfg(test)]
            pub(crate) fn all_for_tests() -> Self {
                Self { $($ray: LossTerm::for_tests(),)* $($node: LossTerm::for_tests(),)* }
            }

            /// Each term of rays alone: its name, how near its gradient is to differences, whether it is detached.
            #[cfg(test)]
            pub(crate) fn each_ray_term() -> Vec<(&'static str, Self, f64, bool)> {
                vec![$((
                    stringify!($ray),
                    Self { $ray: LossTerm::for_tests(), ..Self::none() },
                    <$Ray>::slack(),
                    <$Ray>::is_detached(),
                ),)*]
            }
        }

        #[cfg(test)]
        impl RayLosses {
            /// Names and values.
            pub fn named(&self) -> Vec<(&'static str, f32)> {
                vec![$((stringify!($ray), self.$ray),)*]
            }
        }
    };
}
