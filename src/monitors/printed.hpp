// Numbers as the sentences of the monitors have them.
#pragma once

#include <cstdio>
#include <string>

namespace servosense {

inline std::string printed(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%.4g", value);
  return text;
}

}  // namespace servosense
