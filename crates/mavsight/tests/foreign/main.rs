//! Files of other programs: what `mavsight convert` writes is read by the programs themselves, and what
//! they write by it.
//!
//! The interpreter is MAVSIGHT_PYTHON, or python3; a case whose packages it has not is skipped with a
//! message.

mod bad;
mod boards;
mod lab;
mod python;
