// What one gets without knowing machines: a library of terms on the residual, sequential
// thresholded least squares (Brunton, Proctor and Kutz 2016), the threshold chosen by AIC.
#pragma once

#include <string>
#include <vector>

#include "case.hpp"

namespace blind {

/// Names of the terms that stay, strongest first; only what the user has is looked at. Empty for
/// cases that it was not made for (milling).
std::vector<std::string> plain_library(const Case&);

}  // namespace blind
