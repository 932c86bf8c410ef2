// The cutting force of a real lathe from its drives, on tools that the fit has not seen: a straight
// line on the torque of the spindle, and beside it the current of the feed axis, which carries the
// feed force. Set turning-torque-force (Vicomtech, CC BY-SA 4.0), not shipped.
#include <Eigen/QR>
#include <cmath>
#include <fstream>
#include <map>
#include <set>
#include <sstream>
#include <string>
#include <vector>

#include "check.hpp"

namespace {

using Table = std::map<std::string, std::vector<double>>;

Table read(const std::string& path) {
  std::ifstream in(path);
  std::vector<std::string> names;
  Table table;
  for (std::string line; std::getline(in, line);) {
    if (line.empty() || line[0] == '#') continue;
    std::stringstream fields(line);
    std::string field;
    const bool heading = names.empty();
    for (std::size_t i = 0; std::getline(fields, field, ','); ++i) {
      if (heading)
        names.push_back(field);
      else
        table[names[i]].push_back(std::strtod(field.c_str(), nullptr));
    }
  }
  return table;
}

/// Rms error of the force [N] where each tool is estimated from all others.
double error_on_other_tools(const Table& t, const std::vector<std::string>& columns) {
  const std::vector<double>&force = t.at("F_c_MEAN"), &tool = t.at("tool");
  double squares = 0;
  for (const double left_out : std::set<double>(tool.begin(), tool.end())) {
    std::vector<std::size_t> taught, held;
    for (std::size_t i = 0; i < tool.size(); ++i)
      (tool[i] == left_out ? held : taught).push_back(i);
    const auto design = [&](const std::vector<std::size_t>& rows) {
      Eigen::MatrixXd x(static_cast<Eigen::Index>(rows.size()),
                        static_cast<Eigen::Index>(columns.size()) + 1);
      for (Eigen::Index r = 0; r < x.rows(); ++r) {
        x(r, 0) = 1;
        for (Eigen::Index c = 1; c < x.cols(); ++c)
          x(r, c) =
              t.at(columns[static_cast<std::size_t>(c) - 1])[rows[static_cast<std::size_t>(r)]];
      }
      return x;
    };
    const auto forces = [&](const std::vector<std::size_t>& rows) {
      Eigen::VectorXd y(static_cast<Eigen::Index>(rows.size()));
      for (Eigen::Index r = 0; r < y.size(); ++r) y[r] = force[rows[static_cast<std::size_t>(r)]];
      return y;
    };
    const Eigen::VectorXd fit = design(taught).colPivHouseholderQr().solve(forces(taught));
    squares += (forces(held) - design(held) * fit).squaredNorm();
  }
  return std::sqrt(squares / static_cast<double>(tool.size()));
}

}  // namespace

int main() {
  const std::string folder = check::outside_data("turning-torque-force");
  if (folder.empty()) return check::done();
  const Table t = read(folder + "/segments_1s.csv");
  CHECK(t.at("tool").size() == 1457);
  const double line = error_on_other_tools(t, {"TV2.S_MEAN"});
  const double both = error_on_other_tools(t, {"TV2.S_MEAN", "CV3.Z_MEAN"});
  check::figure("cutting force from the torque of the spindle, other tools", line, "N rms");
  check::figure("with the current of the feed axis", both, "N rms");
  CHECK_BETWEEN(line, 40, 50);
  CHECK(both < 30);
  return check::done();
}
