//! `kinematics`
