mod colour;
mod image;
mod lasting;
mod refusals;
mod sensitivities;
mod support;
mod unstable;
mod white_noise;
