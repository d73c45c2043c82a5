//! Gathering rows of a tensor, with backward passes that a GPU can share out.
//!
//! burn's own `select` adds up gradients with one work-item per column, which goes through all rows in turn: for a column
//! of numbers, one work-item of some ten thousand. Where no row is picked twice, its gradient is a row of the answer's
//! gradient, and can be gathered in turn ([`DistinctRows`]). Where rows repeat, the sum is a matrix product
//! ([`gather_rows`]). Both add in a fixed order: the same bits in every run.

#[cfg(feature = "gpu")]
use burn::backend::Cube;
use burn::backend::autodiff::checkpoint::base::Checkpointer;
use burn::backend::autodiff::checkpoint::strategy::CheckpointStrategy;
use burn::backend::autodiff::grads::Gradients;
use burn::backend::autodiff::ops::{Backward, Ops, OpsKind, unary};
use burn::backend::tensor::{FloatTensor, IntTensor};
use burn::backend::{Autodiff, Backend, Dispatch, Flex, TensorMetadata, backend_extension};
use burn::tensor::{Device, IndexingUpdateOp, Int, Shape, Tensor, TensorData};

/// Some rows of a tensor, none of them twice.
#[derive(Clone, Debug)]
pub struct DistinctRows {
    /// Their numbers, `[n]`.
    index: Tensor<1, Int>,
    /// For each row of the tensor its place among them, and `n` where it is not, `[m]`.
    place: Tensor<1, Int>,
}

impl DistinctRows {
    /// Rows `index` of tensors that have `of` rows, on `device`, which is without autodiff. Each number is below `of`, and
    /// there once.
    pub fn new(index: &[i64], of: usize, device: &Device) -> Self {
        let mut place = vec![index.len() as i64; of];
        for (i, &row) in (0..).zip(index) {
            debug_assert_eq!(place[row as usize], index.len() as i64, "row {row} is there once");
            place[row as usize] = i;
        }
        let tensor = |values: Vec<i64>| {
            let count = values.len();
            Tensor::from_data(TensorData::new(values, [count]), device)
        };
        Self { index: tensor(index.to_vec()), place: tensor(place) }
    }

    /// These rows: `[m, c]` to `[n, c]`, on the graph.
    pub fn gather(&self, values: Tensor<2>) -> Tensor<2> {
        Tensor::from_dispatch(<Dispatch as GatherRows>::gather_distinct_rows(
            values.into_dispatch(),
            self.index.clone().into_dispatch(),
            self.place.clone().into_dispatch(),
        ))
    }

    /// Scatters numbers to where these rows are, with zeros elsewhere: `[n]` to `[m]`, not on the graph.
    pub fn scatter(&self, values: Tensor<1>) -> Tensor<1> {
        let zero = Tensor::zeros([1], &values.device());
        Tensor::cat(vec![values, zero], 0).select(0, self.place.clone())
    }

    /// The same of a column: `[m]` to `[n]`.
    pub fn gather_column(&self, values: Tensor<1>) -> Tensor<1> {
        self.gather(values.unsqueeze_dim(1)).squeeze_dim(1)
    }
}

/// Gathers the rows `index`, `[n]`, of `values`, `[m, c]`, on the graph; rows may repeat. For an `m` that is small beside `n`.
pub fn gather_rows(values: Tensor<2>, index: Tensor<1, Int>) -> Tensor<2> {
    Tensor::from_dispatch(<Dispatch as GatherRows>::gather_rows(values.into_dispatch(), index.into_dispatch()))
}

/// The operations as an extension of burn's backends; use [`DistinctRows`] and [`gather_rows`].
#[backend_extension(Autodiff, Flex, Cube: cfg(feature = "gpu"))]
pub trait GatherRows: Backend {
    /// `[m, c]` and `[n]` to `[n, c]`.
    fn gather_rows(values: FloatTensor<Self>, index: IntTensor<Self>) -> FloatTensor<Self> {
        Self::float_select(values, 0, index)
    }

    /// `[m, c]`, `[n]` and `[m]` to `[n, c]`; only the autodiff backend uses `place`.
    fn gather_distinct_rows(
        values: FloatTensor<Self>,
        index: IntTensor<Self>,
        place: IntTensor<Self>,
    ) -> FloatTensor<Self> {
        let _ = place;
        Self::float_select(values, 0, index)
    }
}

/// The transpose of [`gather_rows`], for its backward pass.
pub trait ScatterAddRows: GatherRows {
    /// Adds the rows of `by`, `[n, c]`, into `rows` rows at `index`, `[n]`: `[rows, c]`.
    fn scatter_add_rows(by: FloatTensor<Self>, index: IntTensor<Self>, rows: usize) -> FloatTensor<Self> {
        let zeros = Self::float_zeros(Shape::new([rows, by.shape()[1]]), &by.device(), by.dtype().into());
        Self::float_select_assign(zeros, 0, index, by, IndexingUpdateOp::Add)
    }
}

impl GatherRows for Flex {}
impl ScatterAddRows for Flex {}

#[cfg(feature = "gpu")]
impl GatherRows for Cube {}

#[cfg(feature = "gpu")]
impl ScatterAddRows for Cube {
    /// A product with the matrix that has a 1 where a row of `by` belongs.
    fn scatter_add_rows(by: FloatTensor<Self>, index: IntTensor<Self>, rows: usize) -> FloatTensor<Self> {
        use burn::backend::ops::{BoolTensorOps, FloatTensorOps, IntTensorOps};
        use burn::tensor::{BoolStore, DType};
        let (count, device) = (index.shape()[0], by.device());
        let row = Self::int_arange(0..rows as i64, &device, index.dtype().into());
        let row = Self::int_expand(Self::int_reshape(row, Shape::new([rows, 1])), Shape::new([rows, count]));
        let index = Self::int_expand(Self::int_reshape(index, Shape::new([1, count])), Shape::new([rows, count]));
        let belongs = Self::int_equal(row, index, DType::Bool(BoolStore::U32).into());
        Self::float_matmul(Self::bool_into_float(belongs, by.dtype().into()), by)
    }
}

impl<B: ScatterAddRows, C: CheckpointStrategy> GatherRows for Autodiff<B, C> {
    fn gather_rows(values: FloatTensor<Self>, index: IntTensor<Self>) -> FloatTensor<Self> {
        #[derive(Debug)]
        struct Repeated;

        impl<B: ScatterAddRows> Backward<B, 1> for Repeated {
            type State = (IntTensor<B>, usize);

            fn backward(self, ops: Ops<Self::State, 1>, grads: &mut Gradients, _checkpointer: &mut Checkpointer) {
                let (index, rows) = ops.state;
                unary::<B, _>(ops.parents, ops.node, grads, |by| B::scatter_add_rows(by, index, rows));
            }
        }

        let rows = values.primitive().shape()[0];
        match Repeated.prepare::<C>([values.node()]).compute_bound().stateful() {
            OpsKind::Tracked(prep) => {
                prep.finish((index.clone(), rows), B::gather_rows(values.into_primitive(), index))
            }
            OpsKind::UnTracked(prep) => prep.finish(B::gather_rows(values.into_primitive(), index)),
        }
    }

    fn gather_distinct_rows(
        values: FloatTensor<Self>,
        index: IntTensor<Self>,
        place: IntTensor<Self>,
    ) -> FloatTensor<Self> {
        #[derive(Debug)]
        struct Distinct;

        impl<B: Backend> Backward<B, 1> for Distinct {
            type State = IntTensor<B>;

            fn backward(self, ops: Ops<Self::State, 1>, grads: &mut Gradients, _checkpointer: &mut Checkpointer) {
                let place = ops.state;
                unary::<B, _>(ops.parents, ops.node, grads, |by| {
                    // Rows that were not picked take the row of zeros behind the others.
                    let zeros = B::float_zeros(Shape::new([1, by.shape()[1]]), &by.device(), by.dtype().into());
                    B::float_select(B::float_cat(vec![by, zeros], 0), 0, place)
                });
            }
        }

        match Distinct.prepare::<C>([values.node()]).compute_bound().stateful() {
            OpsKind::Tracked(prep) => prep.finish(place, B::float_select(values.into_primitive(), 0, index)),
            OpsKind::UnTracked(prep) => prep.finish(B::float_select(values.into_primitive(), 0, index)),
        }
    }
}
