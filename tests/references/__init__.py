"""Our tasks written out by hand, class by class: what their kernels are compared with."""
