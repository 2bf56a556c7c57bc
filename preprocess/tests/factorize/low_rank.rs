//! Files that hold factors.

use preprocess::Btf;
use preprocess::factorize::{factorize, factorize_product};
use preprocess::npy::Samples;
use preprocess::source::{Images, LowRank};
use std::ops::Range;
use std::path::Path;

use crate::common::{noise, product_error, singular_values};
use crate::support::{defect, settings};

/// A BTF whose file holds factors.
#[derive(Debug)]
struct Product(LowRank);

impl Images for Product {
    fn format(&self) -> String {
        "factors".into()
    }

    fn stored_bytes(&self) -> u64 {
        0
    }

    fn samples<'a>(&'a self, _: Range<usize>, _: &'a mut Vec<f32>) -> preprocess::Result<Samples<'a>> {
        panic!("its samples need not be read")
    }

    fn place(&self, image: usize) -> String {
        image.to_string()
    }

    fn low_rank(&self) -> preprocess::Result<Option<LowRank>> {
        Ok(Some(self.0.clone()))
    }
}

#[test]
fn factors_in_a_file_are_not_factorized_again() {
    let (views, lights, width, height) = (5, 4, 13, 9);
    let (rows, columns) = (views * lights * 3, (width * height) as usize);
    let mut random = noise(4);
    for (terms, copies) in [(7, 1), (7, 2), (40, 1), (1, 1)] {
        // Terms that are neither orthogonal nor sorted, of very different sizes; some twice.
        let mut product = LowRank {
            terms: terms * copies,
            ..LowRank::default()
        };
        for term in 0..terms {
            let size = 10f32.powi(2 - (term as i32 * 5) % 7);
            let u: Vec<f32> = (0..rows).map(|_| 0.3 + random()).collect();
            let v: Vec<f32> = (0..columns).map(|_| size * (0.2 + random())).collect();
            for _ in 0..copies {
                product.u.extend(&u);
                product.v.extend(&v);
            }
        }
        let exact: Vec<f64> = (0..rows * columns)
            .map(|at| {
                let term = |t: usize| {
                    f64::from(product.u[t * rows + at / columns])
                        * f64::from(product.v[t * columns + at % columns])
                };
                (0..product.terms).map(term).sum()
            })
            .collect();
        let images = Box::new(Product(product));
        let sampling = crate::common::sampling(views, lights);
        let btf = Btf::new(Path::new("product.btf"), sampling, (width, height), images).unwrap();
        let truth = singular_values(&exact, rows, columns);
        let norm = exact.iter().map(|x| x * x).sum::<f64>().sqrt();
        for components in [1, 3, 60] {
            let factors = factorize(&btf, &settings(components), &|_| ()).unwrap();
            assert_eq!(factors.statistics.passes, 0);
            assert!((factors.energy.sqrt() / norm - 1.0).abs() < 1e-6);
            let measured = product_error(&exact, rows, columns, &factors.u, &factors.v);
            let stated = factors.relative_error();
            assert!(
                (stated - measured).abs() < 0.01 * measured + 1e-6,
                "{stated}, {measured}"
            );
            for (value, truth) in factors.singular_values.iter().zip(&truth) {
                assert!((value - truth).abs() < 1e-6 * norm, "{value} for {truth}");
            }
            assert!(defect(&factors.u, rows, factors.components) < 1e-5);
            let mean: f64 = exact.iter().sum::<f64>() / exact.len() as f64;
            let stated = factors.mean_rgb.iter().sum::<f64>() / 3.0;
            assert!((mean - stated).abs() < 1e-6 * norm);
        }
    }
}

#[test]
fn eigen_textures_take_the_memory_of_the_product() {
    let (terms, rows, columns) = (9, 5 * 4 * 3, 64 * 64);
    let mut random = noise(5);
    let product = LowRank {
        terms,
        u: (0..terms * rows).map(|_| 0.3 + random()).collect(),
        v: (0..terms * columns).map(|_| random()).collect(),
    };
    let images = Box::new(Product(LowRank::default()));
    let btf = Btf::new(
        Path::new("blend"),
        crate::common::sampling(5, 4),
        (64, 64),
        images,
    )
    .unwrap();
    for components in [9, 4] {
        let given = product.clone();
        let memory = given.v.as_ptr();
        let factors = factorize_product(&btf, given, &settings(components)).unwrap();
        assert_eq!(factors.components, components as usize);
        assert_eq!(factors.v.capacity(), components as usize * columns);
        assert!(components < 9 || factors.v.as_ptr() == memory, "a copy was made");
    }
}
