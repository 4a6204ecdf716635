//! The isochor command.
fn main() {}
