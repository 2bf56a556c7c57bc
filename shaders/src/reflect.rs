//! What a mirror says about its members, to be compared with WGSL.

use glam::{Mat4, UVec2, Vec2, Vec3, Vec4};

/// A type with a counterpart in WGSL.
pub trait WgslType {
    /// The counterpart's name, in full: `vec3<f32>`.
    fn name() -> String;
}

macro_rules! wgsl_types {
    ($($rust:ty => $wgsl:literal),* $(,)?) => {
        $(impl WgslType for $rust {
            fn name() -> String {
                $wgsl.into()
            }
        })*
    };
}

wgsl_types!(
    u32 => "u32",
    f32 => "f32",
    Vec2 => "vec2<f32>",
    Vec3 => "vec3<f32>",
    Vec4 => "vec4<f32>",
    UVec2 => "vec2<u32>",
    Mat4 => "mat4x4<f32>",
);

impl<T: WgslType, const N: usize> WgslType for [T; N] {
    fn name() -> String {
        format!("array<{}, {N}>", T::name())
    }
}

/// One member of a mirror.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Field {
    /// Name, the same in Rust and WGSL.
    pub name: &'static str,
    /// Type in WGSL.
    pub ty: String,
    /// Bytes from the start of the struct.
    pub offset: usize,
    /// Bytes.
    pub size: usize,
}

/// A Rust struct with the memory layout of a WGSL struct of the same name.
pub trait Mirror: bytemuck::Pod {
    /// Name of the struct.
    const NAME: &'static str;
    /// Members in the order of memory.
    fn fields() -> Vec<Field>;
}

/// Declares a struct and lists its members.
macro_rules! mirror {
    ($(#[$meta:meta])* pub struct $name:ident { $($(#[$doc:meta])* pub $field:ident: $ty:ty,)* }) => {
        $(#[$meta])*
        #[repr(C)]
        #[derive(Clone, Copy, Debug, Default, bytemuck::Pod, bytemuck::Zeroable)]
        pub struct $name {
            $($(#[$doc])* pub $field: $ty,)*
        }

        impl $crate::Mirror for $name {
            const NAME: &'static str = stringify!($name);

            fn fields() -> Vec<$crate::Field> {
                vec![$($crate::Field {
                    name: stringify!($field),
                    ty: <$ty as $crate::WgslType>::name(),
                    offset: std::mem::offset_of!($name, $field),
                    size: size_of::<$ty>(),
                },)*]
            }
        }

        impl $crate::WgslType for $name {
            fn name() -> String {
                stringify!($name).into()
            }
        }
    };
}
pub(crate) use mirror;
