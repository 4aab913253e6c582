//! Physics of the whole system.
