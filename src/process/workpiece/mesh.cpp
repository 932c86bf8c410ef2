#include "servosense/process/workpiece/mesh.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <iterator>
#include <optional>
#include <unordered_map>

#include "servosense/io/line_reader.hpp"
#include "servosense/io/text.hpp"

namespace servosense::process {
namespace {

static_assert(std::endian::native == std::endian::little, "binary STL is little-endian");

constexpr std::size_t kStlHeader = 80, kStlTriangle = 50;

struct CornerHash {
  std::size_t operator()(const Point& p) const {
    std::uint64_t h = 0;
    for (const double v : p)
      h = (h ^ std::bit_cast<std::uint64_t>(v)) * 0x9E3779B97F4A7C15U, h ^= h >> 29U;
    return static_cast<std::size_t>(h);
  }
};

/// Triangles as they come, each with the place of the file that it comes from.
class MeshBuilder {
 public:
  MeshBuilder(std::string name, const char* places) : name_(std::move(name)), places_(places) {}

  [[nodiscard]] Error error_at(std::size_t place, const std::string& what) const {
    return data_error(name_ + ":" + (*places_ == '\0' ? "" : places_) + std::to_string(place) +
                      ": " + what);
  }
  std::optional<Error> put(const std::array<Point, 3>& corners, std::size_t place) {
    std::array<std::uint32_t, 3> t{};
    for (std::size_t i = 0; i < 3; ++i) {
      Point p = corners[i];
      for (double& v : p) {
        if (!std::isfinite(v))
          return error_at(place, "a coordinate is not finite; export the file again");
        v = v == 0 ? 0 : v;  // one zero
      }
      const auto [at, is_new] =
          number_.try_emplace(p, static_cast<std::uint32_t>(mesh_.corners.size()));
      if (is_new) mesh_.corners.push_back(p);
      t[i] = at->second;
    }
    if (t[0] != t[1] && t[1] != t[2] && t[2] != t[0])
      mesh_.triangles.push_back(t), place_.push_back(place);
    return {};
  }
  Expected<Mesh> finish(double unit_m) {
    if (mesh_.triangles.empty())
      return error_at(1, "there is no triangle; export the solid as STL again");
    if (const auto open = open_edge()) return *open;
    double low = 1e300, high = -1e300, farthest = 0;
    for (std::size_t i = 0; i < 3; ++i) {
      for (const Point& p : mesh_.corners) low = std::min(low, p[i]), high = std::max(high, p[i]);
      farthest = std::max(farthest, high - low);
      low = 1e300, high = -1e300;
    }
    const double unit = unit_m > 0 ? unit_m : farthest < kLargestInMetres ? 1 : 1e-3;
    for (Point& p : mesh_.corners)
      for (double& v : p) {
        v *= unit;
        if (std::abs(v) > kFarthestCorner)
          return error_at(1, "a corner lies " + printed(std::abs(v)) + " m from zero, more than " +
                                 printed(kFarthestCorner) + "; check the unit (--stl-unit)");
      }
    for (std::size_t i = 0; i < 3; ++i) {
      const auto [least, most] =
          std::minmax_element(mesh_.corners.begin(), mesh_.corners.end(),
                              [&](const Point& a, const Point& b) { return a[i] < b[i]; });
      if (!((*most)[i] > (*least)[i]))
        return error_at(1, "the solid is flat; export one that has a volume");
    }
    return std::move(mesh_);
  }

 private:
  [[nodiscard]] std::optional<Error> open_edge() const {
    struct Edge {
      std::uint32_t low, high;
      int sense;
      std::uint32_t triangle;
    };
    std::vector<Edge> edges;
    edges.reserve(3 * mesh_.triangles.size());
    for (std::size_t n = 0; n < mesh_.triangles.size(); ++n)
      for (std::size_t i = 0; i < 3; ++i) {
        const std::uint32_t a = mesh_.triangles[n][i], b = mesh_.triangles[n][(i + 1) % 3];
        edges.push_back(
            {std::min(a, b), std::max(a, b), a < b ? 1 : -1, static_cast<std::uint32_t>(n)});
      }
    std::sort(edges.begin(), edges.end(), [](const Edge& a, const Edge& b) {
      return std::array{a.low, a.high, a.triangle} < std::array{b.low, b.high, b.triangle};
    });
    for (std::size_t i = 0; i < edges.size();) {
      int sum = 0;
      std::size_t end = i;
      for (;
           end < edges.size() && edges[end].low == edges[i].low && edges[end].high == edges[i].high;
           ++end)
        sum += edges[end].sense;
      if (sum != 0) {
        const auto at = [&](std::uint32_t corner) {
          const Point& p = mesh_.corners[corner];
          return "(" + printed(p[0]) + ", " + printed(p[1]) + ", " + printed(p[2]) + ")";
        };
        const std::string edge =
            "the edge of this triangle from " + at(edges[i].low) + " to " + at(edges[i].high);
        return error_at(place_[edges[i].triangle],
                        end - i == 1 ? "the surface is not closed: " + edge +
                                           " belongs to no other; repair the mesh"
                                     : "the surface has no inside: the triangles at " + edge +
                                           " do not face the same way; repair the mesh");
      }
      i = end;
    }
    return {};
  }

  std::string name_;
  const char* places_;
  Mesh mesh_;
  std::vector<std::size_t> place_;
  std::unordered_map<Point, std::uint32_t, CornerHash> number_;
};

Expected<Mesh> binary_stl(std::string_view bytes, const std::string& name, double unit_m) {
  MeshBuilder builder(name, "triangle ");
  const std::size_t count = (bytes.size() - kStlHeader - 4) / kStlTriangle;
  for (std::size_t n = 0; n < count; ++n) {
    std::array<float, 12> v{};
    std::memcpy(v.data(), bytes.data() + kStlHeader + 4 + n * kStlTriangle, sizeof v);
    std::array<Point, 3> corners{};
    for (std::size_t i = 0; i < 9; ++i) corners[i / 3][i % 3] = static_cast<double>(v[3 + i]);
    if (const auto fault = builder.put(corners, n + 1)) return *fault;
  }
  return builder.finish(unit_m);
}

std::vector<std::string_view> words_of(std::string_view line) {
  std::vector<std::string_view> words;
  constexpr std::string_view blanks = " \t\r";
  for (std::size_t at = line.find_first_not_of(blanks); at != std::string_view::npos;) {
    const std::size_t end = std::min(line.find_first_of(blanks, at), line.size());
    words.push_back(line.substr(at, end - at));
    at = line.find_first_not_of(blanks, end);
  }
  return words;
}

Expected<Mesh> text_stl(std::string_view bytes, const std::string& name, double unit_m) {
  MeshBuilder builder(name, "");
  // facet normal, outer loop, three vertices, endloop, endfacet.
  static constexpr std::array<std::string_view, 7> kOrder = {
      "facet", "outer", "vertex", "vertex", "vertex", "endloop", "endfacet"};
  std::size_t number = 0, state = 0;
  bool in_solid = false;
  std::array<Point, 3> corners{};
  while (!bytes.empty()) {
    const std::size_t end = std::min(bytes.find('\n'), bytes.size());
    const auto words = words_of(bytes.substr(0, end));
    bytes.remove_prefix(std::min(end + 1, bytes.size()));
    ++number;
    if (words.empty()) continue;
    if (state == 0 && !in_solid && words[0] == "solid") {
      in_solid = true;
      continue;
    }
    if (state == 0 && in_solid && words[0] == "endsolid") {
      in_solid = false;
      continue;
    }
    if (!in_solid || words[0] != kOrder[state])
      return builder.error_at(
          number, "expected '" + std::string(in_solid ? kOrder[state] : "solid") + "', found " +
                      in_quotes(words[0]) + "; give an STL file, text or binary");
    if (words[0] == "vertex") {
      Point p{};
      for (std::size_t i = 0; i < 3; ++i) {
        const auto value = words.size() == 4 ? parse_number(words[i + 1])
                                             : ParsedNumber<double>{0, NumberFault::not_a_number};
        if (!value.ok())
          return builder.error_at(number,
                                  "a vertex has three finite numbers; export the file again");
        p[i] = value.value;
      }
      corners[state - 2] = p;
    }
    if (++state == kOrder.size()) {
      state = 0;
      if (const auto fault = builder.put(corners, number)) return *fault;
    }
  }
  if (in_solid)
    return builder.error_at(std::max<std::size_t>(number, 1),
                            "the file ends within a solid; it is cut short, copy it again");
  return builder.finish(unit_m);
}

}  // namespace

Expected<Mesh> stl_of(std::string_view bytes, const std::string& name, double unit_m) {
  if (bytes.size() >= kStlHeader + 4) {
    std::uint32_t count = 0;
    std::memcpy(&count, bytes.data() + kStlHeader, sizeof count);
    if (bytes.size() == kStlHeader + 4 + std::size_t{count} * kStlTriangle)
      return binary_stl(bytes, name, unit_m);
    if (!bytes.starts_with("solid"))
      return data_error(name +
                        ":1: neither a text that begins with 'solid' nor a binary STL file: "
                        "its length is not that of the " +
                        std::to_string(count) + " triangles it names; copy it again");
  }
  return text_stl(bytes, name, unit_m);
}

Expected<Mesh> read_stl(const std::string& path, double unit_m) {
  auto stream = open_for_reading(path);
  if (!stream) return stream.error();
  std::string bytes;
  std::array<char, 65536> chunk{};
  while ((*stream)->read(chunk.data(), chunk.size()), (*stream)->gcount() > 0) {
    bytes.append(chunk.data(), static_cast<std::size_t>((*stream)->gcount()));
    if (bytes.size() > kLargestMesh)
      return data_error(path + ":1: larger than " + std::to_string(kLargestMesh) +
                        " bytes; export the solid with a coarser tolerance");
  }
  if ((*stream)->bad()) return device_error(path + " could not be read to its end; check the disk");
  return stl_of(bytes, printable(path, 1000), unit_m);
}

double volume_of(const Mesh& mesh) {
  double sum = 0;
  for (const auto& t : mesh.triangles) {
    const Point &a = mesh.corners[t[0]], &b = mesh.corners[t[1]], &c = mesh.corners[t[2]];
    sum += a[0] * (b[1] * c[2] - b[2] * c[1]) + a[1] * (b[2] * c[0] - b[0] * c[2]) +
           a[2] * (b[0] * c[1] - b[1] * c[0]);
  }
  return sum / 6;
}

}  // namespace servosense::process
