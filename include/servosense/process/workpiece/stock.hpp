// The raw part: a box, a cylinder or a closed mesh.
#pragma once

#include <string>
#include <variant>

#include "servosense/core/expected.hpp"
#include "servosense/process/tool/sweep.hpp"
#include "servosense/process/workpiece/mesh.hpp"

namespace servosense::process {

struct BoxStock {
  Point low{}, high{};  ///< corners [m], low below high along each axis
};
/// Upright.
struct CylinderStock {
  double x_m = 0, y_m = 0, low_m = 0, high_m = 0, radius_m = 0;
};
using Stock = std::variant<BoxStock, CylinderStock, Mesh>;

/// `box:X0,Y0,Z0,X1,Y1,Z1`, `cylinder:X,Y,Z0,Z1,R` [m], or the name of an STL file
/// (`mesh_unit_m`: see read_stl). Usage error for a form that is none of them, data or device error
/// of the file.
Expected<Stock> read_stock(const std::string& text, double mesh_unit_m = 0);
[[nodiscard]] BoxStock bounds_of(const Stock& stock);

}  // namespace servosense::process
