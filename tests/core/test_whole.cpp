// Counts from quantities of any size.
#include <cmath>
#include <limits>

#include "check.hpp"
#include "servosense/core/whole.hpp"

int main() {
  using servosense::nearest_whole;
  using servosense::whole;
  constexpr double kInfinite = std::numeric_limits<double>::infinity();
  CHECK(whole(0.999) == 0 && whole(1) == 1 && whole(2.5) == 2 &&
        whole(4294967294.5) == 4294967294U);
  CHECK(nearest_whole(0.499) == 0 && nearest_whole(0.5) == 1 && nearest_whole(2.4) == 2);
  CHECK(whole(8589934594.0) == 4294967295U && whole(kInfinite) == 4294967295U);
  CHECK(whole(-1) == 0 && whole(-kInfinite) == 0 && whole(std::nan("")) == 0);
  return check::done();
}
