//! Every shader validates, and every mirror lies in memory as its WGSL struct does.

use naga::{
    Module, TypeInner,
    valid::{Capabilities, ValidationFlags, Validator},
};
use shaders::{
    CHOICES, Field, Mirror, NAMES,
    mirror::{DecodedPage, Frame, Instance, Light, Material, Mip, Overlay, Strip, Triangulation, Vertex},
    shader, variant,
};

fn parse(name: &str) -> Module {
    parse_source(name, &shader(name).unwrap())
}

fn parse_source(name: &str, source: &str) -> Module {
    naga::front::wgsl::parse_str(source)
        .unwrap_or_else(|error| panic!("{name}: {}", error.emit_to_string(source)))
}

/// The name of a type as it is written in WGSL.
fn type_name(module: &Module, ty: naga::Handle<naga::Type>) -> String {
    let scalar = |scalar: naga::Scalar| match scalar.kind {
        naga::ScalarKind::Float => format!("f{}", scalar.width * 8),
        naga::ScalarKind::Uint => format!("u{}", scalar.width * 8),
        kind => format!("{kind:?}"),
    };
    match &module.types[ty].inner {
        TypeInner::Scalar(inner) => scalar(*inner),
        TypeInner::Vector { size, scalar: inner } => format!("vec{}<{}>", *size as u32, scalar(*inner)),
        TypeInner::Matrix {
            columns,
            rows,
            scalar: inner,
        } => {
            format!("mat{}x{}<{}>", *columns as u32, *rows as u32, scalar(*inner))
        }
        TypeInner::Array {
            base,
            size: naga::ArraySize::Constant(length),
            ..
        } => {
            format!("array<{}, {length}>", type_name(module, *base))
        }
        TypeInner::Struct { .. } => module.types[ty].name.clone().unwrap(),
        other => format!("{other:?}"),
    }
}

/// Name, type, offset and size of a member.
type Member = (String, String, usize, usize);

/// Members of a WGSL struct, and its size in bytes.
fn wgsl_fields(module: &Module, name: &str) -> Option<(Vec<Member>, usize)> {
    let (_, ty) = module
        .types
        .iter()
        .find(|(_, ty)| ty.name.as_deref() == Some(name))?;
    let TypeInner::Struct { members, span } = &ty.inner else {
        return None;
    };
    let fields = members.iter().map(|member| {
        let size = module.types[member.ty].inner.size(module.to_ctx());
        (
            member.name.clone().unwrap(),
            type_name(module, member.ty),
            member.offset as usize,
            size as usize,
        )
    });
    Some((fields.collect(), *span as usize))
}

/// What differs between a mirror and the struct of its name.
fn differences<M: Mirror>(module: &Module) -> Option<String> {
    let Some((wgsl, span)) = wgsl_fields(module, M::NAME) else {
        return Some(format!("no struct {}", M::NAME));
    };
    let rust: Vec<_> = M::fields()
        .into_iter()
        .map(
            |Field {
                 name,
                 ty,
                 offset,
                 size,
             }| (name.to_owned(), ty, offset, size),
        )
        .collect();
    (rust != wgsl || span != size_of::<M>()).then(|| {
        format!(
            "{}: Rust {} bytes {rust:#?}, WGSL {span} bytes {wgsl:#?}",
            M::NAME,
            size_of::<M>()
        )
    })
}

/// What a shader may need: nothing beyond core WebGPU, to which unpack2x16float belongs, but for sums of half floats.
fn capabilities(file: &str) -> Capabilities {
    let core = Capabilities::SHADER_FLOAT16_IN_FLOAT32;
    match file {
        "half" => core | Capabilities::SHADER_FLOAT16,
        _ => core,
    }
}

#[test]
fn every_entry_point_validates() {
    let mut entry_points = Vec::new();
    for name in NAMES {
        let module = parse(name);
        Validator::new(ValidationFlags::all(), capabilities(name))
            .validate(&module)
            .unwrap_or_else(|error| panic!("{name}: {}", error.emit_to_string(&shader(name).unwrap())));
        entry_points.extend(module.entry_points.iter().map(|entry| entry.name.clone()));
    }
    entry_points.sort();
    assert_eq!(
        entry_points,
        [
            "classify",
            "compact",
            "decode_block",
            "decode_border",
            "decode_store",
            "feedback",
            "overlay",
            "present_fragment",
            "present_vertex",
            "shade_btf",
            "shade_diffuse",
            "shade_mixed",
            "stitch_gather",
            "stitch_scatter",
            "tonemap",
            "visibility_fragment",
            "visibility_vertex"
        ]
    );
}

#[test]
fn every_choice_validates_and_is_another_shader() {
    for (import, files) in CHOICES {
        let importer = if *import == "slots" { "stitch" } else { "shade" };
        let sources: Vec<_> = files
            .iter()
            .map(|file| variant(importer, &[(import, file)]).unwrap())
            .collect();
        for (source, file) in sources.iter().zip(*files) {
            Validator::new(ValidationFlags::all(), capabilities(file))
                .validate(&parse_source(file, source))
                .unwrap_or_else(|error| panic!("{file}: {}", error.emit_to_string(source)));
        }
        assert_eq!(sources[0], shader(importer).unwrap());
        assert!(sources[1..].iter().all(|source| *source != sources[0]));
        assert!(variant(importer, &[(import, "nonsense")]).is_err());
    }
}

#[test]
fn mirrors_lie_in_memory_as_their_wgsl_structs() {
    let module = parse("shade");
    let found = [
        differences::<Frame>(&module),
        differences::<Vertex>(&module),
        differences::<Instance>(&module),
        differences::<Mip>(&module),
        differences::<Triangulation>(&module),
        differences::<Material>(&module),
        differences::<Light>(&module),
        differences::<Strip>(&parse("stitch")),
        differences::<DecodedPage>(&parse("decode")),
        differences::<Overlay>(&parse("overlay")),
    ];
    let found: Vec<_> = found.into_iter().flatten().collect();
    assert!(found.is_empty(), "{}", found.join("\n"));
}

#[test]
fn a_wrong_mirror_is_found() {
    let right = "struct Light { vector: vec3<f32>, kind: u32, intensity: vec3<f32>, pad: u32 }";
    let wrong = [
        right.replace("kind", "sort"),
        right.replace("kind: u32", "kind: f32"),
        right.replace("vec3<f32>, pad: u32", "vec3<f32>"),
        right.replace("kind: u32,", ""),
        right.replace("kind: u32", "kind: vec2<u32>"),
        right.replace("vector: vec3<f32>, kind: u32", "kind: u32, vector: vec3<f32>"),
    ];
    let check = |source: &str| {
        let source = format!("{source}\n@group(0) @binding(0) var<uniform> light: Light;");
        differences::<Light>(&naga::front::wgsl::parse_str(&source).unwrap())
    };
    assert_eq!(check(right), None);
    for source in wrong {
        assert!(check(&source).is_some(), "{source}");
    }
}
