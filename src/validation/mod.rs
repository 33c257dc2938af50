//! `validation`
