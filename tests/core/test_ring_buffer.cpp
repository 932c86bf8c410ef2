// Ring buffers against std::deque.
#include <array>
#include <deque>
#include <random>
#include <string>

#include "check.hpp"
#include "servosense/core/ring_buffer.hpp"

namespace {

using servosense::RingBuffer;
using servosense::RingView;

template <typename Ring>
void against_deque(Ring& ring, std::size_t capacity, unsigned seed) {
  std::mt19937 random(seed);
  std::deque<int> expected;
  bool same = true;
  for (int n = 0; n < 5000; ++n) {
    if (random() % 500 == 0) {
      ring.clear();
      expected.clear();
    }
    const int value = static_cast<int>(random());
    int displaced = 0;
    if (expected.size() == capacity) {
      displaced = expected.front();
      expected.pop_front();
    }
    expected.push_back(value);
    same = same && ring.push(value) == displaced && ring.size() == expected.size() &&
           ring.full() == (expected.size() == capacity);
    for (std::size_t i = 0; i < expected.size(); ++i)
      same = same && ring[i] == expected[i] && ring.newest(expected.size() - 1 - i) == expected[i];
  }
  check::that(same, ("ring = deque, seed " + std::to_string(seed)).c_str(), __FILE__, __LINE__);
  CHECK(ring.capacity() == capacity);
}

template <std::size_t Capacity>
void both(unsigned seed) {
  RingBuffer<int, Capacity> owner;
  against_deque(owner, Capacity, seed);
  std::array<int, Capacity> memory{};
  RingView<int> view(memory);
  against_deque(view, Capacity, seed + 1);
  // A copy stands alone: a ring may be part of a block's state.
  RingBuffer<int, Capacity> copy = owner;
  const int newest = owner.newest();
  copy.push(newest + 1);
  CHECK(owner.newest() == newest && copy.newest() == newest + 1);
}

}  // namespace

int main() {
  both<1>(1);
  both<2>(3);
  both<7>(5);
  both<64>(7);
  static_assert(std::is_trivially_copyable_v<RingBuffer<float, 9>>);
  return check::done();
}
