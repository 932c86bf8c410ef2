// STL files: solids against closed forms and against the same stock as a primitive; what is no
// solid is refused.
#include <cstring>
#include <random>

#include "cut_parts.hpp"
#include "io/malformed.hpp"
#include "servosense/process/workpiece/mesh.hpp"

using namespace cut_parts;

namespace {

using Triangle = std::array<Point, 3>;

std::vector<Triangle> box(const Point& a, const Point& b) {
  std::vector<Triangle> all;
  const auto corner = [&](unsigned bits) {
    return Point{(bits & 1U) != 0 ? b[0] : a[0], (bits & 2U) != 0 ? b[1] : a[1],
                 (bits & 4U) != 0 ? b[2] : a[2]};
  };
  const unsigned faces[6][4] = {{0, 2, 3, 1}, {4, 5, 7, 6}, {0, 1, 5, 4},
                                {2, 6, 7, 3}, {0, 4, 6, 2}, {1, 3, 7, 5}};
  for (const auto& f : faces) {
    all.push_back({corner(f[0]), corner(f[1]), corner(f[2])});
    all.push_back({corner(f[0]), corner(f[2]), corner(f[3])});
  }
  return all;
}

/// A prism on a regular polygon, whose area is (n / 2) r^2 sin(2 pi / n).
std::vector<Triangle> prism(int n, double radius, double z0, double z1) {
  std::vector<Triangle> all;
  const auto at = [&](int i, double z) {
    const double angle = 2 * std::numbers::pi * (i % n) / n;
    return Point{radius * std::cos(angle), radius * std::sin(angle), z};
  };
  for (int i = 0; i < n; ++i) {
    all.push_back({at(i, z0), at(i + 1, z0), at(i + 1, z1)});
    all.push_back({at(i, z0), at(i + 1, z1), at(i, z1)});
    all.push_back({Point{0, 0, z1}, at(i, z1), at(i + 1, z1)});
    all.push_back({Point{0, 0, z0}, at(i + 1, z0), at(i, z0)});
  }
  return all;
}

std::string text_of(const std::vector<Triangle>& all) {
  std::string text = "solid part\n";
  char line[120];
  for (const Triangle& t : all) {
    text += "facet normal 0 0 0\n outer loop\n";
    for (const Point& p : t) {
      std::snprintf(line, sizeof line, "  vertex %.9g %.9g %.9g\n", p[0], p[1], p[2]);
      text += line;
    }
    text += " endloop\nendfacet\n";
  }
  return text + "endsolid part\n";
}

std::string binary_of(const std::vector<Triangle>& all) {
  std::string bytes(80, 's');
  bytes.replace(0, 5, "solid");  // as some programs write it
  const auto put = [&](auto value) {
    char raw[sizeof value];
    std::memcpy(raw, &value, sizeof value);
    bytes.append(raw, sizeof value);
  };
  put(static_cast<std::uint32_t>(all.size()));
  for (const Triangle& t : all) {
    for (int i = 0; i < 3; ++i) put(0.0F);
    for (const Point& p : t)
      for (const double v : p) put(static_cast<float>(v));
    put(static_cast<std::uint16_t>(0));
  }
  return bytes;
}

Mesh mesh_of(const std::string& bytes) {
  auto mesh = stl_of(bytes, "part.stl", 1e-3);
  if (!mesh) {
    check::fail(__FILE__, __LINE__) << mesh.error().sentence << '\n';
    std::exit(check::done());
  }
  return *mesh;
}

double stock_volume(const Stock& stock) {
  const auto workpiece = Workpiece::of(stock, 2e-4);
  CHECK(workpiece.has_value());
  return workpiece ? workpiece->volume_m3() : 0;
}

void solids() {
  const Mesh block = mesh_of(text_of(box({0, 0, -20}, {60, 40, 0})));
  CHECK_NEAR(volume_of(block), 60 * 40 * 20e-9, 1e-15);
  CHECK_NEAR(stock_volume(Stock(block)), 60 * 40 * 20e-9, 1e-11);
  const Mesh again = mesh_of(binary_of(box({0, 0, -20}, {60, 40, 0})));
  CHECK(again.corners == block.corners && again.triangles.size() == 12);

  const int n = 48;
  const double area = n / 2.0 * 400 * std::sin(2 * std::numbers::pi / n);
  const Mesh round = mesh_of(binary_of(prism(n, 20, -30, 0)));
  CHECK_NEAR(volume_of(round) / (area * 30e-9), 1, 1e-6);  // floats
  CHECK_NEAR(stock_volume(Stock(round)) / (area * 30e-9), 1, 1e-3);

  // A hollow one: a box within a box, facing inwards.
  auto shell = box({0, 0, 0}, {30, 30, 30});
  for (Triangle t : box({10, 10, 10}, {20, 20, 20})) {
    std::swap(t[0], t[1]);
    shell.push_back(t);
  }
  CHECK_NEAR(stock_volume(Stock(mesh_of(text_of(shell)))), 26000e-9, 26e-9);
}

/// The same program in the same stock, as a primitive and as a mesh.
void as_the_primitive() {
  const Cutter tool = cutter_of({CutterKind::flat, 10e-3});
  const std::string program = "G0 Z5\nG0 X-12 Y17\nG0 Z-3.3\nG1 X72\nG1 Y30\nG1 X30";
  const Cut a = cut(box_mm(0, 0, -20, 60, 40, 0), {tool}, program);
  const Cut b = cut(Stock(mesh_of(text_of(box({0, 0, -20}, {60, 40, 0})))), {tool}, program);
  CHECK_TEXT(a.error + b.error, "");
  CHECK_NEAR(b.removed_m3 / a.removed_m3, 1, 1e-6);
  CHECK(a.steps.size() == b.steps.size());
  double worst = 0;
  for (std::size_t i = 0; i < std::min(a.steps.size(), b.steps.size()); ++i) {
    CHECK(a.steps[i].arcs.size() == b.steps[i].arcs.size());
    for (std::size_t k = 0; k < std::min(a.steps[i].arcs.size(), b.steps[i].arcs.size()); ++k)
      worst = std::max({worst, std::abs(a.steps[i].arcs[k].from_deg - b.steps[i].arcs[k].from_deg),
                        std::abs(a.steps[i].arcs[k].to_deg - b.steps[i].arcs[k].to_deg)});
  }
  CHECK(worst < 0.05);
}

/// Any one triangle that is missing or turned round is found.
void broken_ones(std::mt19937& random) {
  const auto whole = prism(12, 20, -5, 5);
  for (int i = 0; i < 20; ++i) {
    auto broken = whole;
    const std::size_t at = random() % broken.size();
    const bool missing = random() % 2 == 0;
    if (missing)
      broken.erase(broken.begin() + static_cast<std::ptrdiff_t>(at));
    else
      std::swap(broken[at][0], broken[at][1]);
    const auto mesh = stl_of(binary_of(broken), "part.stl", 1e-3);
    CHECK(!mesh);
    if (mesh) continue;
    CHECK(mesh.error().sentence.starts_with("part.stl:triangle "));
    CHECK(mesh.error().sentence.find(missing ? "not closed" : "same way") != std::string::npos);
  }
}

void units() {
  const auto size = [](const std::vector<Triangle>& all, double unit) {
    const auto mesh = stl_of(text_of(all), "part.stl", unit);
    CHECK(mesh.has_value());
    return mesh ? bounds_of(Stock(*mesh)).high[0] : 0;
  };
  CHECK_NEAR(size(box({0, 0, 0}, {60, 40, 20}), 0), 0.06, 1e-12);
  CHECK_NEAR(size(box({0, 0, 0}, {0.06, 0.04, 0.02}), 0), 0.06, 1e-9);
  CHECK_NEAR(size(box({0, 0, 0}, {2, 1, 1}), 0.0254), 0.0508, 1e-12);
}

}  // namespace

int main() {
  std::mt19937 random(20260802U);
  solids();
  as_the_primitive();
  broken_ones(random);
  units();
  malformed::check_all("stl", 7, [](const std::string& path) {
    const auto mesh = read_stl(path, 1e-3);
    return mesh ? servosense::Error{} : mesh.error();
  });
  return check::done();
}
