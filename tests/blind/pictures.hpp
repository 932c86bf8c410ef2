// The summary as pictures for docs/images, readable on light and on dark paper.
#pragma once

#include <string>
#include <vector>

#include "summary.hpp"

namespace blind {

struct Picture {
  std::string file;
  std::string svg;
};

std::vector<Picture> pictures_of(const Summary&);

}  // namespace blind
