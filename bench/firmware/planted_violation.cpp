// What no real-time block may do. Never linked: the symbol gates must refuse this object.
#include <cmath>
#include <cstdlib>
#include <vector>

void* from_the_heap(std::size_t bytes) { return std::malloc(bytes); }

void grow(std::vector<float>& samples, float value) { samples.push_back(value); }

namespace bench {

// Looks like a block of the table, and calls the mathematics library.
template <typename Real>
struct PlantedCase {
  Real step(Real x) { return std::sin(x); }
};

template <typename Case>
float step(void* block, float x) {
  return static_cast<Case*>(block)->step(x);
}
template float step<PlantedCase<float>>(void* block, float x);

}  // namespace bench
