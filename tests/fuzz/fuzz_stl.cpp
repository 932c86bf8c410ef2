// Any bytes as an STL file: an error of one line that names where, or a closed solid of finite
// corners that a workpiece can be made of.
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <string_view>

#include "servosense/process/workpiece/workpiece.hpp"

using namespace servosense::process;

namespace {

void require(bool ok) {
  if (!ok) std::abort();
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string_view bytes(reinterpret_cast<const char*>(data), size);
  const auto mesh = stl_of(bytes, "fuzz", 0);
  if (!mesh) {
    require(mesh.error().sentence.find('\n') == std::string::npos);
    require(mesh.error().sentence.starts_with("fuzz:"));
    return 0;
  }
  for (const Point& p : mesh->corners)
    for (const double v : p) require(std::abs(v) <= kFarthestCorner);
  const Stock stock(*mesh);
  const BoxStock box = bounds_of(stock);
  double longest = 0;
  for (std::size_t i = 0; i < 3; ++i) longest = std::max(longest, box.high[i] - box.low[i]);
  const auto workpiece = Workpiece::of(stock, longest / 20);
  require(workpiece.has_value());
  const double volume = workpiece->volume_m3();
  require(volume >= 0 && volume <= 1.01 * longest * longest * longest);
  return 0;
}
