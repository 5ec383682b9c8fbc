mod sensitivities;
mod support;
mod white_noise;
