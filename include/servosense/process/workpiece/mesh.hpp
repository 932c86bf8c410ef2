// A closed surface of triangles, and STL files, text or binary.
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "servosense/core/expected.hpp"
#include "servosense/process/tool/sweep.hpp"

namespace servosense::process {

struct Mesh {
  std::vector<Point> corners;                           ///< [m]
  std::vector<std::array<std::uint32_t, 3>> triangles;  ///< counterclockwise seen from outside
};

/// Corners of STL files that are alike to the last bit are one; triangles without area are left
/// out. An STL file has no unit: `unit_m` is that of its numbers; 0: metres where the solid is
/// less than kLargestInMetres long, wide and high, else millimetres.
///
/// Data error that says what and where (line of a text file, triangle of a binary one) for a file
/// that is none, with a number that is not finite, without triangles, or whose surface is not
/// closed: every edge belongs to two triangles that run along it in opposite senses.
Expected<Mesh> read_stl(const std::string& path, double unit_m);
Expected<Mesh> stl_of(std::string_view bytes, const std::string& name, double unit_m);

/// Bytes of an STL file that is read: 20 million triangles of a binary one (chosen).
inline constexpr std::size_t kLargestMesh = std::size_t{1} << 30U;
/// No solid of less than a millimetre is milled, and few of more than a metre (chosen).
inline constexpr double kLargestInMetres = 1;
/// No corner is farther from zero [m] (chosen): floats hold it to a micrometre.
inline constexpr double kFarthestCorner = 10;

/// Volume that the surface encloses [m3], by the divergence theorem; negative if its triangles run
/// clockwise.
[[nodiscard]] double volume_of(const Mesh& mesh);

}  // namespace servosense::process
