//! From a file to a scene: the walk over the nodes.

use std::collections::BTreeMap;
use std::path::Path;

use glam::{Affine3A, Mat3A, Mat4, Quat, Vec3};
use gltf::json::scene::Node;
use gltf::json::{Index, Root};

use super::accessor::Reader;
use super::container::{self, Container};
use super::notes::Notes;
use super::{Detail, MAX_INSTANCES, geometry, look};
use crate::{Error, Instance, Mesh, Result, Scene};

/// A scene from a file.
#[derive(Clone, Debug)]
pub struct Loaded {
    /// The scene.
    pub scene: Scene,
    /// What of the file is not shown or was mended, in one line each; at most [`super::MAX_NOTES`].
    pub notes: Vec<String>,
}

/// Loads the default scene of a file, or its first; [`open`] without its notes.
///
/// # Errors
/// As [`open`].
pub fn load(path: &Path) -> Result<Scene> {
    open(path).map(|loaded| loaded.scene)
}

/// Loads the default scene of a file, or its first.
///
/// # Errors
/// [`Error::Io`], or [`Error::Invalid`] that says what is wrong, where, and what to do: damaged files, indices
/// and offsets out of range, transforms and colours that are not finite, buffers outside the scene's folder, compressed
/// meshes and other extensions that the file requires, more than the limits of this module. Meshes with numbers that
/// are not finite are mended, and what is not drawn is left out, both with a note.
pub fn open(path: &Path) -> Result<Loaded> {
    let container = Container::read(path)?;
    build(&container).map_err(|detail| Error::Invalid {
        path: path.into(),
        detail,
    })
}

/// As [`open`], of a file that is in memory: in a browser. `name` stands for it in messages, `buffers` are those of
/// [`externals`], in the same order.
///
/// # Errors
/// [`Error::Invalid`], as [`open`]; also if a buffer is missing.
pub fn parse(name: &str, bytes: &[u8], buffers: Vec<Vec<u8>>) -> Result<Loaded> {
    let path = Path::new(name);
    let mut buffers = buffers.into_iter();
    let container = Container::parse(path, bytes, |uri, _| {
        let buffer = buffers.next();
        buffer.ok_or_else(|| format!("uri {uri:?} was not loaded"))
    })?;
    build(&container).map_err(|detail| Error::Invalid {
        path: path.into(),
        detail,
    })
}

/// What has to be loaded before [`parse`]: URIs of buffers that lie beside the file, relative to it and none of them above it, as
/// they are written in it.
///
/// # Errors
/// [`Error::Invalid`] if the file is no glTF, or a URI leads out of its folder.
pub fn externals(name: &str, bytes: &[u8]) -> Result<Vec<String>> {
    container::externals(bytes).map_err(|detail| Error::Invalid {
        path: name.into(),
        detail,
    })
}

fn build(container: &Container) -> Detail<Loaded> {
    let root = &container.root;
    let (at, chosen) = match root.scene {
        Some(index) => (index.value(), root.get(index)),
        None => (0, root.scenes.first()),
    };
    let chosen = chosen.ok_or_else(|| format!("there is no scenes[{at}]: export the file with a scene"))?;
    let mut builder = Builder {
        root,
        reader: Reader {
            root,
            buffers: &container.buffers,
            elements: 0,
        },
        scene: Scene {
            materials: look::materials(root)?,
            ..Scene::default()
        },
        primitives: BTreeMap::new(),
        mirrors: BTreeMap::new(),
        cameras: Vec::new(),
        notes: Notes::default(),
    };
    builder.notes.survey(root);
    look::environment(chosen, &mut builder.scene)?;
    builder.walk(&chosen.nodes)?;
    let Builder {
        mut scene,
        cameras,
        notes,
        ..
    } = builder;
    let bounds = scene.bounds();
    scene.cameras = cameras
        .iter()
        .map(|(node, perspective, world)| {
            look::camera(perspective, *world, bounds).map_err(|detail| format!("nodes[{node}]: {detail}"))
        })
        .collect::<Detail<_>>()?;
    Ok(Loaded {
        scene,
        notes: notes.finish(),
    })
}

struct Builder<'a> {
    root: &'a Root,
    reader: Reader<'a>,
    scene: Scene,
    /// Meshes by glTF mesh: one for each primitive.
    primitives: BTreeMap<usize, Vec<usize>>,
    /// Mirror images of meshes.
    mirrors: BTreeMap<usize, usize>,
    /// Cameras wait for the scene's bounds, which tell how far away their target is.
    cameras: Vec<(usize, &'a gltf::json::camera::Perspective, Affine3A)>,
    notes: Notes,
}

impl<'a> Builder<'a> {
    /// Visits the nodes below `roots`, with an own stack: files may nest deeper than the machine's.
    fn walk(&mut self, roots: &[Index<Node>]) -> Detail<()> {
        let mut seen = vec![false; self.root.nodes.len()];
        let mut open: Vec<_> = roots
            .iter()
            .rev()
            .map(|node| (*node, Affine3A::IDENTITY))
            .collect();
        while let Some((index, world_from_parent)) = open.pop() {
            let at = index.value();
            let node = self
                .root
                .get(index)
                .ok_or_else(|| format!("there is no nodes[{at}]"))?;
            if std::mem::replace(&mut seen[at], true) {
                return Err(format!(
                    "nodes[{at}] has two parents or is its own ancestor: nodes must form trees"
                ));
            }
            let named = |detail| format!("nodes[{at}]: {detail}");
            let world_from_node = world_from_parent * transform(node).map_err(named)?;
            if !world_from_node.is_finite() {
                return Err(named("its transform is not finite".into()));
            }
            self.visit(at, node, world_from_node).map_err(named)?;
            open.extend(
                node.children
                    .iter()
                    .flatten()
                    .rev()
                    .map(|child| (*child, world_from_node)),
            );
        }
        Ok(())
    }

    fn visit(&mut self, at: usize, node: &'a Node, world_from_node: Affine3A) -> Detail<()> {
        if let Some(mesh) = node.mesh {
            self.place(at, mesh, world_from_node)?;
        }
        if let Some(extension) = node
            .extensions
            .as_ref()
            .and_then(|all| all.khr_lights_punctual.as_ref())
        {
            let light = self.root.get(extension.light);
            let light = light.ok_or_else(|| format!("there is no light {}", extension.light.value()))?;
            match look::light(light, world_from_node)? {
                Some(light) => self.scene.lights.push(light),
                None => self.notes.add(format!(
                    "nodes[{at}]: its spot light is not drawn; directional and point lights are"
                )),
            }
        }
        if let Some(index) = node.camera {
            let camera = self
                .root
                .get(index)
                .ok_or_else(|| format!("there is no cameras[{}]", index.value()))?;
            match &camera.perspective {
                Some(perspective) => self.cameras.push((at, perspective, world_from_node)),
                None => self.notes.add(format!(
                    "nodes[{at}]: its camera is not perspective; it is left out"
                )),
            }
        }
        Ok(())
    }

    fn place(&mut self, at: usize, index: Index<gltf::json::Mesh>, world_from_node: Affine3A) -> Detail<()> {
        let determinant = world_from_node.matrix3.determinant();
        if !determinant.is_finite() {
            return Err("its scale is so large that volumes are not finite".into());
        }
        if determinant == 0.0 {
            // How many programs hide things.
            self.notes.add(format!(
                "nodes[{at}]: its scale is zero along some axis; its mesh is left out"
            ));
            return Ok(());
        }
        for mesh in self.meshes(index)? {
            if self.scene.instances.len() >= MAX_INSTANCES {
                return Err(format!("the scene places more than {MAX_INSTANCES} primitives"));
            }
            let instance = if determinant > 0.0 {
                Instance {
                    mesh,
                    world_from_mesh: world_from_node,
                }
            } else {
                let mirror = Affine3A::from_scale(Vec3::new(-1.0, 1.0, 1.0));
                Instance {
                    mesh: self.mirror(mesh),
                    world_from_mesh: world_from_node * mirror,
                }
            };
            self.scene.instances.push(instance);
        }
        Ok(())
    }

    fn meshes(&mut self, index: Index<gltf::json::Mesh>) -> Detail<Vec<usize>> {
        let at = index.value();
        if let Some(meshes) = self.primitives.get(&at) {
            return Ok(meshes.clone());
        }
        let mesh = self
            .root
            .get(index)
            .ok_or_else(|| format!("there is no meshes[{at}]"))?;
        let mut meshes = Vec::new();
        for (which, primitive) in mesh.primitives.iter().enumerate() {
            let named = |detail| format!("meshes[{at}].primitives[{which}]: {detail}");
            let material = match primitive.material {
                Some(material) if material.value() >= self.root.materials.len() => {
                    return Err(named(format!("there is no materials[{}]", material.value())));
                }
                Some(material) => material.value(),
                None => look::default_material(self.root.materials.len(), &mut self.scene.materials),
            };
            if let Some(what) = geometry::undrawn(primitive) {
                self.notes.add(named(format!(
                    "is drawn as {what}; only triangles, strips and fans are shown"
                )));
                continue;
            }
            let notes = &mut self.notes;
            let mut note = |what| notes.add(named(what));
            let mesh = geometry::mesh(&mut self.reader, primitive, material, &mut note).map_err(named)?;
            if !mesh.indices.is_empty() {
                self.scene.meshes.push(mesh);
                meshes.push(self.scene.meshes.len() - 1);
            }
        }
        self.primitives.insert(at, meshes.clone());
        Ok(meshes)
    }

    fn mirror(&mut self, mesh: usize) -> usize {
        let meshes: &mut Vec<Mesh> = &mut self.scene.meshes;
        *self.mirrors.entry(mesh).or_insert_with(|| {
            meshes.push(meshes[mesh].mirrored());
            meshes.len() - 1
        })
    }
}

/// A node's own transform: a matrix, or translation · rotation · scale.
fn transform(node: &Node) -> Detail<Affine3A> {
    if let Some(matrix) = node.matrix {
        let matrix = Mat4::from_cols_array(&matrix);
        // Products of matrices in f32 leave a little.
        if !matrix.row(3).abs_diff_eq(glam::Vec4::W, 1e-4) {
            return Err("the last row of its matrix is not 0 0 0 1".into());
        }
        return Ok(Affine3A::from_mat4(matrix));
    }
    let rotation = Quat::from_array(node.rotation.unwrap_or_default().0);
    let length = rotation.length();
    if !(length.is_finite() && length > 1e-6) {
        return Err("its rotation is no quaternion: all zero, or not finite".into());
    }
    let scale = Vec3::from(node.scale.unwrap_or([1.0; 3]));
    let matrix = Mat3A::from_quat(rotation / length) * Mat3A::from_diagonal(scale);
    Ok(Affine3A {
        matrix3: matrix,
        translation: node.translation.unwrap_or_default().into(),
    })
}
