mod colour;
mod image;
mod refusals;
mod sensitivities;
mod support;
mod systematic;
mod unstable;
mod white_noise;
