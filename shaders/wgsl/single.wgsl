// Sums over directions in single precision. Stands for `arithmetic`; `half` is the other way.

alias Real = f32;
