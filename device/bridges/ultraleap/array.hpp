// What the program needs of an array. sdk3.cpp and sdk2.cpp each have one, and nothing else knows the vendor's library.
#pragma once

#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

#include "player.hpp"

namespace palpate {

// A sentence on what went wrong: the program prints it and ends with exit code 1, or answers FAIL with it.
struct Failure : std::runtime_error {
  using std::runtime_error::runtime_error;
};

// The same for a wrong command line: exit code 2.
struct Misuse : std::runtime_error {
  using std::runtime_error::runtime_error;
};

struct ArrayInfo {
  std::string library, identifier, model, firmware;  // `library` is its version
};

class FocusArray {
 public:
  virtual ~FocusArray() = default;
  virtual ArrayInfo info() = 0;

  // Samples a second [Hz] that the library takes of so many points at most; 0 if it does not take so many.
  virtual double rate_limit(unsigned point_count) = 0;

  // Makes the library ready for so many points at the highest rate [Hz], which it returns.
  virtual double set_up(unsigned point_count) = 0;

  // Starts and stops the library's calls to the Player that the array was made with.
  virtual void start() = 0;
  virtual void stop() = 0;

  // Callbacks that the library says it missed since `start`; -1 if it does not count them.
  virtual long long missed_callbacks() = 0;
};

struct ArrayOptions {
  std::string device;   // identifier; empty: the first that takes focal points
  std::string connect;  // way to the library's service; empty: the library's own
};

// Each SDK's file defines these.
const char* sdk_name();  // with the version of its headers
std::unique_ptr<FocusArray> open_array(const ArrayOptions& options, Player& player);
std::vector<std::string> list_arrays(const ArrayOptions& options);

constexpr unsigned points_most = 8;  // focal points a sample that palpate has at most

// Focal points a sample that the array takes.
inline unsigned point_limit(FocusArray& array) {
  unsigned count = 0;
  while (count < points_most && array.rate_limit(count + 1) > 0) ++count;
  return count;
}

}  // namespace palpate
