//! Elementary functions in `f32`, the same bits on the board and the desktop.
use micromath::F32Ext;
/// eˣ.
pub fn exp(x: f32) -> f32 {
    F32Ext::exp(x)
}
/// ln x.
pub fn ln(x: f32) -> f32 {
    F32Ext::ln(x)
}
/// tanh x.
pub fn tanh(x: f32) -> f32 {
    let e = exp(-2.0 * x);
    (1.0 - e) / (1.0 + e)
}
/// sin x.
pub fn sin(x: f32) -> f32 {
    F32Ext::sin(x)
}
/// cos x.
pub fn cos(x: f32) -> f32 {
    F32Ext::cos(x)
}
