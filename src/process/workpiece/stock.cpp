#include "servosense/process/workpiece/stock.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

#include "servosense/io/text.hpp"

namespace servosense::process {
namespace {

/// Numbers between commas; nothing if there are not `count` of them.
std::vector<double> numbers_of(std::string_view text, std::size_t count) {
  std::vector<double> all;
  while (true) {
    const std::size_t comma = text.find(',');
    const auto number = parse_number(trim(text.substr(0, comma)));
    if (!number.ok()) return {};
    all.push_back(number.value);
    if (comma == std::string_view::npos) break;
    text.remove_prefix(comma + 1);
  }
  if (all.size() != count) all.clear();
  return all;
}

bool near_zero(const std::vector<double>& values) {
  return std::all_of(values.begin(), values.end(),
                     [](double v) { return std::abs(v) <= kFarthestCorner; });
}

}  // namespace

Expected<Stock> read_stock(const std::string& text, double mesh_unit_m) {
  const auto fault = [&](const std::string& what) {
    return usage_error("--stock " + in_quotes(text) + ": " + what);
  };
  const std::string far =
      "metres are asked for, at most " + printed(kFarthestCorner) + " from zero";
  if (text.starts_with("box:")) {
    const auto v = numbers_of(std::string_view(text).substr(4), 6);
    if (v.empty()) return fault("give box:X0,Y0,Z0,X1,Y1,Z1 in metres");
    if (!near_zero(v)) return fault(far);
    BoxStock box;
    for (std::size_t i = 0; i < 3; ++i) {
      box.low[i] = v[i], box.high[i] = v[i + 3];
      if (!(box.low[i] < box.high[i]))
        return fault("the first corner is the lower one along x, y and z");
    }
    return Stock(box);
  }
  if (text.starts_with("cylinder:")) {
    const auto v = numbers_of(std::string_view(text).substr(9), 5);
    if (v.empty()) return fault("give cylinder:X,Y,Z0,Z1,R in metres");
    if (!near_zero(v)) return fault(far);
    if (!(v[2] < v[3]) || !(v[4] > 0)) return fault("Z0 is below Z1, and R above 0");
    return Stock(CylinderStock{v[0], v[1], v[2], v[3], v[4]});
  }
  auto mesh = read_stl(text, mesh_unit_m);
  if (!mesh) return mesh.error();
  return Stock(std::move(*mesh));
}

BoxStock bounds_of(const Stock& stock) {
  if (const auto* box = std::get_if<BoxStock>(&stock)) return *box;
  if (const auto* c = std::get_if<CylinderStock>(&stock))
    return {{c->x_m - c->radius_m, c->y_m - c->radius_m, c->low_m},
            {c->x_m + c->radius_m, c->y_m + c->radius_m, c->high_m}};
  const auto& corners = std::get<Mesh>(stock).corners;
  BoxStock box{corners.front(), corners.front()};
  for (const Point& p : corners)
    for (std::size_t i = 0; i < 3; ++i)
      box.low[i] = std::min(box.low[i], p[i]), box.high[i] = std::max(box.high[i], p[i]);
  return box;
}

}  // namespace servosense::process
