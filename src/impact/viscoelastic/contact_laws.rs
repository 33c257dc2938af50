//! Which published laws ball, strings and friction follow: Goodwill's (the default) or the older ones the thesis reviews.

macro_rules! choice {
    ($(#[$meta:meta])* $name:ident, $key:literal: $($(#[$m:meta])* $variant:ident = $text:literal),* $(,)?) => {
        $(#[$meta])*
        #[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
        pub enum $name {
            $($(#[$m])* $variant,)*
        }

        impl $name {
            /// Its key in `[parameters]`.
            pub const KEY: &'static str = $key;
            /// What the model file may say.
            pub const NAMES: &'static [&'static str] = &[$($text),*];

            /// From the model file's word.
            pub fn from_name(name: &str) -> Option<Self> {
                match name {
                    $($text => Some($name::$variant),)*
                    _ => None,
                }
            }
        }
    };
}

choice! {
    /// Force of the ball on its compression.
    BallLaw, "ball_law":
    /// Stiffening spring, damping that grows with the contact area, momentum flux (Goodwill and Haake; thesis 2.30 to 2.34).
    #[default] Goodwill = "goodwill",
    /// Constant spring and damper (Dignall and Haake 2000, Pratt 2000; thesis 2.29): the force jumps at first touch and pulls
    /// before the ball is round again.
    KelvinVoigt = "kelvin-voigt",
    /// Stiffening spring with a constant damper (Leigh and Lui 1992).
    LeighLui = "leigh-lui",
}

choice! {
    /// Force of the stringbed on its deflection.
    StringLaw, "string_law":
    /// Stiffening spring with a small damper (thesis 2.35, 2.36).
    #[default] Goodwill = "goodwill",
    /// Constant spring and damper.
    KelvinVoigt = "kelvin-voigt",
    /// Purely elastic (Leigh and Lui 1992, thesis fig 2.33).
    LeighLui = "leigh-lui",
}

choice! {
    /// When the contact ends.
    Release, "release":
    /// When the strings no longer push.
    #[default] Force = "force",
    /// When the ball's centre is back where it touched (Dignall and Haake 2000): a Kelvin-Voigt ball is pulled at the end.
    Displacement = "displacement",
}

choice! {
    /// Where the normal force acts.
    NormalForce, "normal_force":
    /// Through the ball's centre, unless an effect moves it.
    #[default] Central = "central",
    /// Off centre by the momentum flux of a spinning ball: its front lands faster than its rear (Haake, Carre, Kirk and
    /// Senior 2005; thesis 2.7.2).
    Haake = "haake",
}

choice! {
    /// Direction of friction on a sliding ball.
    FrictionDirection, "friction_direction":
    /// Against the slip: Coulomb.
    #[default] Slip = "slip",
    /// Along the impulse that would stop the slip, cut to the limit: what first-order time stepping does (physics reference,
    /// C.5 b). Differs from Coulomb's by a tenth of a degree; the reference's test vectors G.7 have it.
    Projected = "projected",
}

/// All choices of one model.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct ContactLaws {
    pub ball: BallLaw,
    pub strings: StringLaw,
    pub release: Release,
    pub normal_force: NormalForce,
    pub friction_direction: FrictionDirection,
}

impl BallLaw {
    /// Defaults of the base's parameters that this law replaces, by name.
    ///
    /// Kelvin-Voigt: the constants with which a ball leaves a wall at 0.57 of 20 m/s after 3.6 ms (see
    /// [`crate::impact::closed_form::kelvin_voigt_constants`]). Leigh-Lui: the stiffness of the default law, and the damper
    /// with which 7 m/s come back at 0.745, the range in which that model was tested.
    pub fn defaults(self) -> &'static [(&'static str, f64)] {
        match self {
            BallLaw::Goodwill => &[],
            BallLaw::KelvinVoigt => &[("k_B0", 45.3e3), ("A_K", 0.0), ("A_C", 0.0), ("c_B0", 18.0)],
            BallLaw::LeighLui => &[("A_C", 0.0), ("c_B0", 7.8)],
        }
    }

    /// When its contact ends unless the model file says otherwise.
    pub fn release(self) -> Release {
        if self == BallLaw::KelvinVoigt { Release::Displacement } else { Release::Force }
    }
}

impl StringLaw {
    /// As [`BallLaw::defaults`].
    pub fn defaults(self) -> &'static [(&'static str, f64)] {
        match self {
            StringLaw::Goodwill => &[],
            StringLaw::KelvinVoigt => &[("kS2", 0.0)],
            StringLaw::LeighLui => &[("c_S", 0.0)],
        }
    }
}
