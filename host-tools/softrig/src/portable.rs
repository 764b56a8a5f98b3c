//! The same recordings have the same verdict on every computer.
//!
//! A fit that is ill-conditioned makes a percent out of a last bit, and a close decision another
//! verdict. So no number of a verdict depends on who computes it: powers, exponentials and sines are
//! those of the crate `libm` (Clippy refuses a platform's own, `clippy.toml`), larger matrices are
//! multiplied by [`product`], and parallel work is put together in the order of the work, never in
//! that of its ending. What is left are the distributions of `statrs` and the tails of normal numbers
//! that are drawn, which use the platform's logarithms and which no fit follows, and the poles of
//! [`crate::linear`].

use nalgebra::{DMatrix, Dyn, Matrix, Storage};

/// The product of two matrices, by one scalar product for each element.
///
/// nalgebra's operator has the fused multiplications of whatever processor runs it, from six rows
/// and columns on.
pub fn product<A, B>(a: &Matrix<f64, Dyn, Dyn, A>, b: &Matrix<f64, Dyn, Dyn, B>) -> DMatrix<f64>
where
    A: Storage<f64, Dyn, Dyn>,
    B: Storage<f64, Dyn, Dyn>,
{
    a.transpose().tr_mul(b)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_product_is_the_product() {
        let a = DMatrix::from_fn(7, 9, |row, column| (row * 9 + column) as f64);
        let b = DMatrix::from_fn(9, 8, |row, column| (row as f64) - (column as f64).powi(2));
        assert_eq!(product(&a, &b), &a * &b);
    }
}
