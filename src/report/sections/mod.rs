//! The report's sections: one file each, a pure function from plain results to a [`super::Section`], `None` without data.
