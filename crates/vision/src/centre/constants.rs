//! Numbers that several stages of a fit share.

/// Smallest radius whose centre is fitted.
pub(crate) const LEAST_RADIUS_PX: f64 = 1.5;
/// Standard deviation of a one-pixel box: no edge is sharper.
pub(super) const PIXEL_STD_PX: f64 = 0.288_675;
/// Coverage below which a pixel counts as clear of the ball, and above one less which as inside it.
pub(super) const CLEAR: f32 = 0.01;
/// Movement after which the background is estimated again. The outcome of a step as short is predicted,
/// whatever it is in standard deviations.
pub(super) const SAME_PLACE_PX: f64 = 0.1;
/// Part of the diameter by which a centre may be off whatever the image shows: moulded balls are round to a
/// few thousandths (the rules of table tennis allow six), and the light on them is modelled to about as much.
pub const MODEL_STD: f64 = 0.001;
/// Standard deviations by which a ball must differ from its background in some channel.
pub(super) const LEAST_CONTRAST: f64 = 6.0;
/// Standard deviations of the shading's coefficients of first and second order as parts of the ball's colour:
/// a matt sphere lit from one side and half as much from all around has 0.5, and passes what light has of the
/// second order 3/8 as strongly as what it has of the first (Ramamoorthi & Hanrahan 2001, eq. 9).
pub(super) const SHADE_STD: [f64; 2] = [0.5, 0.2];
/// The same of the fourth order: of one lamp alone 3/16 of the first ([`shading`]).
pub(super) const FOURTH_STD: f64 = 3.0 / 16.0 * SHADE_STD[0];
/// Standard deviation of the light that the model leaves out, as a part of the ball's: the sixth order of one
/// lamp, 13/128 of its first, whose square has a mean of 1/13 over the ball.
pub(super) const LIGHT_STD: f64 = 0.0282 * SHADE_STD[0];
/// Noise of a pixel before a film has shown its own: two levels, a consumer camera's in a lit room (shot
/// noise of 8000 electrons is 1.4 levels at half the range).
pub(crate) const NOISE_STD: f64 = 2.0;
