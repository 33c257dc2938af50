//! `reconstruction`
