//! Every row of the catalogue: that it is there, that its signature is its formula's for simple inputs, and that it is
//! not offered where what it needs was not recorded or does not vary.
mod amplitudes;
mod formulas;
mod instruments;
mod offers;
mod scene;
mod thermal;
