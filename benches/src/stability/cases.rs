//! The cases.

use std::sync::Arc;

use super::generate::{material, noise, with_spectrum};
use super::{Bounds, Input, Shape};

/// How large the cases are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sizes {
    /// Seconds for all of them: what the tests run.
    Small,
    /// A few hundred rows and some thousand texels: a minute or two.
    Full,
}

/// A BTF that is hard, and what is promised of it.
pub struct Case {
    /// Its name, for people and scripts.
    pub name: &'static str,
    /// Why its bounds are what they are.
    pub reason: &'static str,
    /// Sizes.
    pub shape: Shape,
    /// Components to ask for.
    pub components: usize,
    /// Its samples; in cases of `harm`, before that.
    pub samples: fn(Shape) -> Vec<f32>,
    /// What is done to the samples, if anything.
    pub harm: Option<Harm>,
    /// What is promised.
    pub bounds: Bounds,
}

impl Case {
    /// The samples before any harm.
    pub fn input(&self) -> Input {
        Input {
            shape: self.shape,
            samples: (self.samples)(self.shape).into(),
        }
    }
}

/// Samples that no reflectance can have.
#[derive(Clone, Debug)]
pub struct Harm {
    /// What is written in place of them.
    pub value: f32,
    /// Which ones, rising.
    pub samples: Vec<usize>,
    /// View, light, channel, x and y of the first.
    pub first: (usize, usize, char, usize, usize),
}

impl Harm {
    fn new(shape: Shape, value: f32, samples: Vec<usize>) -> Self {
        let (row, texel) = (samples[0] / shape.columns(), samples[0] % shape.columns());
        let image = row / 3;
        let first = (
            image / shape.lights,
            image % shape.lights,
            ['r', 'g', 'b'][row % 3],
            texel % shape.width,
            texel / shape.width,
        );
        Self {
            value,
            samples,
            first,
        }
    }

    /// The samples with the harm done.
    pub fn applied(&self, input: &Input) -> Input {
        let mut samples = input.samples.to_vec();
        for &sample in &self.samples {
            samples[sample] = self.value;
        }
        Input {
            shape: input.shape,
            samples: Arc::from(samples),
        }
    }
}

/// The whole suite.
pub fn cases(sizes: Sizes) -> Vec<Case> {
    let shape = match sizes {
        Sizes::Small => Shape {
            views: 4,
            lights: 3,
            width: 24,
            height: 20,
        },
        Sizes::Full => Shape {
            views: 11,
            lights: 9,
            width: 96,
            height: 80,
        },
    };
    // Few directions where there are many texels: the judge holds the whole matrix in f64.
    let (views, lights) = match sizes {
        Sizes::Small => (2, 2),
        Sizes::Full => (4, 5),
    };
    let sized = |width, height| Shape {
        views,
        lights,
        width,
        height,
    };
    let mut all = exact(shape);
    all.extend(spectra(shape));
    all.extend(ranges(shape));
    all.extend(shapes(shape, sized));
    all.extend(harmed(shape));
    all
}

/// A case of the usual bounds.
fn case(name: &'static str, shape: Shape, samples: fn(Shape) -> Vec<f32>) -> Case {
    Case {
        name,
        reason: "nothing about it is hard for f32",
        shape,
        components: 8,
        samples,
        harm: None,
        bounds: Bounds::DEFAULT,
    }
}

/// Cases whose rank is known.
fn exact(shape: Shape) -> Vec<Case> {
    let rank_one = Bounds {
        rank: Some(1),
        ..Bounds::DEFAULT
    };
    let zero = Bounds {
        orthonormality: 0.0,
        optimum_floor: 0.0,
        stated_floor: 0.0,
        half: 0.0,
        ledger_floor: 0.0,
        ..rank_one
    };
    vec![
        Case {
            reason: "zero is exact in every format, and one component of zeros stands for it",
            bounds: zero,
            ..case("zero", shape, |shape| vec![0.0; shape.samples()])
        },
        Case {
            reason: "one component describes it up to the rounding of f32",
            bounds: rank_one,
            ..case("constant", shape, |shape| vec![0.7; shape.samples()])
        },
        Case {
            reason: "one component describes it up to the rounding of f32",
            bounds: rank_one,
            ..case("rank one", shape, |shape| with_spectrum(shape, &[1.0]))
        },
    ]
}

fn spectra(shape: Shape) -> Vec<Case> {
    vec![
        Case {
            reason: "any basis of a space of equal singular values is right, as long as it is one",
            bounds: Bounds {
                rank: Some(6),
                ..Bounds::DEFAULT
            },
            ..case("repeated singular values", shape, |shape| {
                with_spectrum(shape, &[1.0, 1.0, 1.0, 0.1, 0.1, 0.1])
            })
        },
        Case {
            reason: "the cut goes through twelve equal singular values: any eight of them are optimal",
            ..case("repeated, cut within", shape, |shape| {
                with_spectrum(shape, &[1.0; 12])
            })
        },
        Case {
            reason: "the cut is where f32 still tells components apart, 1e-4 of the first",
            components: 4,
            ..case("spectrum to 1e-12, cut at 1e-4", shape, falling)
        },
        Case {
            reason: "f32 samples end at 6e-8 of the largest: what lies below 1e-6 may be left out",
            components: 16,
            ..case("spectrum to 1e-12, all", shape, falling)
        },
        Case {
            reason: "a flat spectrum is the worst for a random subspace, which takes it for the tail of a falling one; \
                     Halko et al. 2011, theorem 10.6, bound its error by a few percent of the optimum",
            bounds: Bounds {
                optimum_ratio: 1.05,
                ..Bounds::DEFAULT
            },
            ..case("noise", shape, |shape| {
                let mut random = noise(3);
                (0..shape.samples()).map(|_| random() as f32).collect()
            })
        },
    ]
}

/// Thirteen singular values from 1 to 1e-12.
fn falling(shape: Shape) -> Vec<f32> {
    let singular_values: Vec<f64> = (0..13).map(|c| 10f64.powi(-c)).collect();
    with_spectrum(shape, &singular_values)
}

/// A material of another size.
fn scaled(shape: Shape, scale: f64) -> Vec<f32> {
    let scale = |sample: f32| (f64::from(sample) * scale) as f32;
    material(shape).into_iter().map(scale).collect()
}

fn ranges(shape: Shape) -> Vec<Case> {
    vec![
        Case {
            reason: "errors are those of the whole matrix: texels of 1e-6 weigh nothing beside those of 1e5",
            ..case("columns of 1e-6 beside 1e5", shape, |shape| {
                let mut samples = material(shape);
                for (index, sample) in samples.iter_mut().enumerate() {
                    *sample *= if index % shape.columns() % 2 == 0 {
                        1e5
                    } else {
                        1e-6
                    };
                }
                samples
            })
        },
        Case {
            reason: "each sample is of its own size, eleven orders of magnitude apart: few of them are all of the matrix, and their \
                     spectrum is flat, as that of noise",
            bounds: Bounds {
                optimum_ratio: 1.05,
                ..Bounds::DEFAULT
            },
            ..case("samples from 1e-6 to 1e5", shape, |shape| {
                let mut random = noise(4);
                let size = |random: f64| 10f64.powf(5.5 * random - 0.5);
                (0..shape.samples()).map(|_| size(random()) as f32).collect()
            })
        },
        Case {
            reason: "a mirror's peak in one sample is a component of its own; the rest of the BTF is what rounding leaves beside it",
            ..case("peak of 1e5 in one sample", shape, |shape| {
                let mut samples = material(shape);
                let middle = shape.samples() / 2 + shape.columns() / 2 + shape.width / 2;
                samples[middle] = 1e5;
                samples
            })
        },
        Case {
            reason: "the archive scales textures by a power of two, which loses nothing",
            ..case("beyond half floats", shape, |shape| scaled(shape, 1e6))
        },
        Case {
            reason: "just within what is accepted: products of f32 must stay finite",
            ..case("largest accepted", shape, |shape| scaled(shape, 2e11))
        },
        Case {
            reason: "half floats below 6e-5 lose precision; the archive scales them up by a power of two",
            ..case("denormal half floats", shape, |shape| scaled(shape, 1e-6))
        },
        Case {
            reason: "samples that are small in f32 beside others that are not weigh nothing",
            ..case("denormals beside ones", shape, |shape| {
                let mut samples = material(shape);
                for sample in samples.iter_mut().step_by(3) {
                    *sample *= 1e-40;
                }
                samples
            })
        },
        Case {
            reason: "f32 has 16 bits left for samples of 1e-40, and for factors of them; an archive holds nothing below \
                     1e-17: all may be lost there, and the ledger has to say so",
            bounds: Bounds {
                orthonormality: 1e-3,
                optimum_floor: 1e-3,
                half: 1.0,
                ..Bounds::DEFAULT
            },
            ..case("denormals", shape, |shape| scaled(shape, 1e-40))
        },
        Case {
            reason: "signs are free: radiance factors are not, but what a colour model leaves may be",
            ..case("negative values", shape, |shape| scaled(shape, -1.0))
        },
        Case {
            reason: "components sum up to nothing, and no mean stands out",
            ..case("both signs", shape, |shape| {
                material(shape)
                    .into_iter()
                    .map(|sample| 10.0 * (sample - 1.0))
                    .collect()
            })
        },
    ]
}

fn shapes(shape: Shape, sized: impl Fn(usize, usize) -> Shape) -> Vec<Case> {
    let single_texel = Shape {
        width: 1,
        height: 1,
        ..shape
    };
    let single_direction = Shape {
        views: 1,
        lights: 1,
        ..shape
    };
    vec![
        Case {
            bounds: Bounds {
                rank: Some(1),
                ..Bounds::DEFAULT
            },
            reason: "a matrix of one column",
            ..case("single texel", single_texel, material)
        },
        Case {
            bounds: Bounds {
                rank: Some(3),
                ..Bounds::DEFAULT
            },
            reason: "a matrix of three rows",
            ..case("single direction", single_direction, material)
        },
        Case {
            bounds: Bounds {
                rank: Some(1),
                ..Bounds::DEFAULT
            },
            reason: "a matrix of three numbers",
            ..case(
                "single texel and direction",
                Shape {
                    views: 1,
                    lights: 1,
                    ..single_texel
                },
                material,
            )
        },
        Case {
            reason: "sides that no page, block or panel divides",
            ..case("346x335", sized(346, 335), material)
        },
        Case {
            reason: "a texture one texel wide",
            ..case("1x4096", sized(1, 4096), material)
        },
        Case {
            reason: "a texture one texel high",
            ..case("4096x1", sized(4096, 1), material)
        },
    ]
}

fn harmed(shape: Shape) -> Vec<Case> {
    // The last view and light, green, somewhere in the middle.
    let row = shape.rows() - 2;
    let one = row * shape.columns() + shape.columns() / 2 + shape.width / 3;
    let image = (shape.rows() / 2 / 3) * 3 * shape.columns();
    let samples = shape.samples() as f64;
    // A neighbour differs from its neighbours by their noise and slope: less than half of the mean.
    let one_repaired = Bounds {
        repair: 0.5 / samples.sqrt(),
        ..Bounds::DEFAULT
    };
    let single = |name, value| Case {
        reason: "the mean of the neighbours is off by less than half of the material's mean",
        harm: Some(Harm::new(shape, value, vec![one])),
        bounds: one_repaired,
        ..case(name, shape, material)
    };
    vec![
        single("one NaN, repaired", f32::NAN),
        single("one infinity, repaired", f32::INFINITY),
        single("one of -1e13, repaired", -1e13),
        Case {
            reason: "rows of this material are independent, so that an image is off from that of the next light by the \
                     difference of two textures: less than its own root mean square",
            harm: Some(Harm::new(
                shape,
                f32::NAN,
                (image..image + 3 * shape.columns()).collect(),
            )),
            bounds: Bounds {
                repair: (3.0 * shape.columns() as f64 / samples).sqrt(),
                ..Bounds::DEFAULT
            },
            ..case("image of NaN, repaired", shape, material)
        },
    ]
}
