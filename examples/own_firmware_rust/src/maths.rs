//! Vectors, rotations and the Earth (`docs/conventions.md`).

use std::array::from_fn;
use std::f64::consts::PI;

pub type Vector = [f64; 3];
/// By rows.
pub type Matrix = [Vector; 3];

pub const IDENTITY: Matrix = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
pub const EARTH_RATE: f64 = 7.292_115e-5;
pub const SEMI_MAJOR_AXIS: f64 = 6_378_137.0;
pub const GRAVITY_EQUATOR: f64 = 9.780_325_335_9;
const FLATTENING: f64 = 1.0 / 298.257_223_563;
const ECCENTRICITY_2: f64 = FLATTENING * (2.0 - FLATTENING);
const GM: f64 = 3.986_004_418e14;
const SOMIGLIANA: f64 = 1.931_852_652_458e-3;

pub fn dot(a: Vector, b: Vector) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

pub fn length(a: Vector) -> f64 {
    dot(a, a).sqrt()
}

pub fn scaled(a: Vector, factor: f64) -> Vector {
    a.map(|x| x * factor)
}

/// a + factor b
pub fn plus(a: Vector, factor: f64, b: Vector) -> Vector {
    from_fn(|i| a[i] + factor * b[i])
}

pub fn cross(a: Vector, b: Vector) -> Vector {
    from_fn(|i| a[(i + 1) % 3] * b[(i + 2) % 3] - a[(i + 2) % 3] * b[(i + 1) % 3])
}

pub fn transposed(a: Matrix) -> Matrix {
    from_fn(|i| from_fn(|j| a[j][i]))
}

pub fn applied(a: Matrix, v: Vector) -> Vector {
    a.map(|row| dot(row, v))
}

pub fn product(a: Matrix, b: Matrix) -> Matrix {
    let columns = transposed(b);
    a.map(|row| columns.map(|column| dot(row, column)))
}

/// The inverse of a symmetric matrix that is positive definite.
pub fn inverse(a: Matrix) -> Option<Matrix> {
    let adjugate: Matrix = from_fn(|i| cross(a[(i + 1) % 3], a[(i + 2) % 3]));
    let determinant = dot(a[0], adjugate[0]);
    (determinant > 0.0).then(|| adjugate.map(|row| scaled(row, 1.0 / determinant)))
}

fn sinc(x: f64) -> f64 {
    if x.abs() < 1e-9 { 1.0 } else { x.sin() / x }
}

/// The rotation by a rotation vector (Rodrigues).
pub fn rotation(phi: Vector) -> Matrix {
    let angle = length(phi);
    let (once, twice) = (sinc(angle), 0.5 * sinc(0.5 * angle).powi(2));
    transposed(IDENTITY.map(|axis| {
        let turned = cross(phi, axis);
        plus(plus(axis, once, turned), twice, cross(phi, turned))
    }))
}

/// The rotation matrix nearest to one that is almost one: C (3 I - Cᵀ C) / 2.
pub fn orthonormal(c: Matrix) -> Matrix {
    let squared = product(transposed(c), c);
    let correction = from_fn(|i| from_fn(|j| 1.5 * IDENTITY[i][j] - 0.5 * squared[i][j]));
    product(c, correction)
}

fn about(axis: usize, angle: f64) -> Matrix {
    rotation(scaled(IDENTITY[axis], angle))
}

/// `C_b_n = Rz(-heading) Rx(pitch) Ry(roll)`
pub fn body_attitude(roll: f64, pitch: f64, heading: f64) -> Matrix {
    product(about(2, -heading), product(about(0, pitch), about(1, roll)))
}

/// `C_s_b = Rx(outer) Rz(inner)`
pub fn gimbal(inner: f64, outer: f64) -> Matrix {
    product(about(0, outer), about(2, inner))
}

/// Roll, pitch and heading of the body, the heading in [0, 2π).
pub fn euler(c: Matrix) -> (f64, f64, f64) {
    let heading = c[0][1].atan2(c[1][1]).rem_euclid(2.0 * PI);
    ((-c[2][0]).atan2(c[2][2]), c[2][1].clamp(-1.0, 1.0).asin(), heading)
}

/// Radii of curvature along the meridian and across it.
pub fn earth_radii(latitude: f64) -> (f64, f64) {
    let root = 1.0 - ECCENTRICITY_2 * latitude.sin().powi(2);
    let across = SEMI_MAJOR_AXIS / root.sqrt();
    (across * (1.0 - ECCENTRICITY_2) / root, across)
}

pub fn gravity(latitude: f64, height: f64) -> f64 {
    let squared = latitude.sin().powi(2);
    let a = SEMI_MAJOR_AXIS;
    let m = EARTH_RATE.powi(2) * a.powi(3) * (1.0 - FLATTENING) / GM;
    let surface =
        GRAVITY_EQUATOR * (1.0 + SOMIGLIANA * squared) / (1.0 - ECCENTRICITY_2 * squared).sqrt();
    let linear = 2.0 * (1.0 + FLATTENING * (1.0 - 2.0 * squared) + m);
    surface * (1.0 - linear * height / a + 3.0 * (height / a).powi(2))
}
