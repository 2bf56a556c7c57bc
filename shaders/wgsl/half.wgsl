// Sums over directions in half precision. Stands for `arithmetic`; `single` is the other way. Weights of taps add up to one,
// so no sum leaves the range of the half floats in it.

enable f16;

alias Real = f16;
