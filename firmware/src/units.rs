//! The units of people, in SI units and radians.

/// Pascal in a kilopascal.
pub const PA_PER_KPA: f32 = 1_000.0;
/// Kilopascal in a pascal: products are cheaper than quotients.
pub const KPA_PER_PA: f32 = 1e-3;
/// Radians in a degree.
pub const RAD_PER_DEG: f32 = core::f32::consts::PI / 180.0;
/// Degrees in a radian.
pub const DEG_PER_RAD: f32 = 180.0 / core::f32::consts::PI;
