mod image;
mod sensitivities;
mod support;
mod unstable;
mod white_noise;
