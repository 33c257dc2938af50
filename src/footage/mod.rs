//! `footage`
