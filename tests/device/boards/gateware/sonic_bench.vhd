-- The published entities behind the UART of a SonicSurface, wired as QuadrupleBuffer.bdf wires them. A byte comes every
-- BYTE_CLOCKS clocks of 10.24 MHz. Reads lines from INPUT: a byte 0..255, or 256 for a look at what is emitted. Writes a
-- line for each look: whether the shift clocks run, then for each of 256 places the count of the 32 steps of a carrier
-- period in which its pulse is high, and the step in which it rises (32: in none).
library ieee;
use ieee.std_logic_1164.all;
use ieee.numeric_std.all;
use std.textio.all;

entity sonic_bench is
  generic (
    INPUT       : string  := "bytes.txt";
    OUTPUT      : string  := "looks.txt";
    BYTE_CLOCKS : natural := 48);
end sonic_bench;

architecture test of sonic_bench is
  signal clk, byte_in, swap, set, swap_long, set_long, swap_late, set_late : std_logic := '0';
  signal multiplex, debug_swap, selected, clocks_on : std_logic;
  signal q_in, data, address : std_logic_vector(7 downto 0) := (others => '0');
  signal count, count_before : std_logic_vector(7 downto 0) := (others => '0');
  signal data_out : std_logic_vector(31 downto 0);
  signal is_over : boolean := false;
begin
  counter : entity work.Counter generic map (COUNTER_BITS => 8)
    port map (clk_in => clk, sync_reset => '0', clk_out => count);
  distribute : entity work.Distribute
    port map (CLK => clk, byte_in => byte_in, q_in => q_in, swap_out => swap, set_out => set, multiplex_out => multiplex,
              data_out => data, address => address, debug_swap => debug_swap, debug_reset => selected,
              debug_onShiftClocks => clocks_on);
  swap_expander : entity work.PulseExpander generic map (OUTPUT_LENGTH_CYCLES => 16)
    port map (clk_in => clk, pulse_in => swap, pulse_out => swap_long);
  set_expander : entity work.PulseExpander generic map (OUTPUT_LENGTH_CYCLES => 16)
    port map (clk_in => clk, pulse_in => set, pulse_out => set_long);
  swap_latch : entity work.LatchBuffer port map (clk_in => count(2), signal_in => swap_long, signal_out => swap_late);
  set_latch : entity work.LatchBuffer port map (clk_in => count(2), signal_in => set_long, signal_out => set_late);
  channels : entity work.AllChannels generic map (NBLOCKS => 256)
    port map (clk8 => clk, clk => count(2), counter => count, swap => swap_late, phase => data, set => set_late,
              address => address, data_out => data_out);

  process
  begin
    while not is_over loop
      clk <= '1'; wait for 49 ns; clk <= '0'; wait for 49 ns;
    end loop;
    wait;
  end process;

  process (clk)
  begin
    if rising_edge(clk) then
      count_before <= count;  -- what the multiplexers select by at this edge
    end if;
  end process;

  process
    file source : text open read_mode is INPUT;
    file sink : text open write_mode is OUTPUT;
    type flags is array (0 to 31) of boolean;
    type grid is array (0 to 255) of flags;
    variable row : line;
    variable value, place, step, high, rise : integer := 0;
    variable pulse : grid;
  begin
    for wait_clock in 1 to 300 loop wait until falling_edge(clk); end loop;
    while not endfile(source) loop
      readline(source, row);
      read(row, value);
      if value < 256 then
        q_in <= std_logic_vector(to_unsigned(value, 8));
        byte_in <= '1';
        wait until falling_edge(clk);
        byte_in <= '0';
        for wait_clock in 2 to BYTE_CLOCKS loop wait until falling_edge(clk); end loop;
      else
        for wait_clock in 1 to 600 loop wait until falling_edge(clk); end loop;  -- two carrier periods
        for look_clock in 0 to 255 loop
          for group_of_8 in 0 to 31 loop
            place := 8 * group_of_8 + to_integer(unsigned(count_before(2 downto 0)));
            step := to_integer(unsigned(count_before(7 downto 3)));
            if unsigned(count_before(2 downto 0)) < 4 then
              step := (step + 31) mod 32;  -- pulses change between the fourth and the fifth place of a group
            end if;
            pulse(place)(step) := data_out(group_of_8) = '1';
          end loop;
          wait until falling_edge(clk);
        end loop;
        if clocks_on = '1' then write(row, 1); else write(row, 0); end if;
        for channel in 0 to 255 loop
          high := 0;
          rise := 32;
          for slot in 0 to 31 loop
            if pulse(channel)(slot) then
              high := high + 1;
              if not pulse(channel)((slot + 31) mod 32) then rise := slot; end if;
            end if;
          end loop;
          write(row, string'(" ")); write(row, high); write(row, string'(" ")); write(row, rise);
        end loop;
        writeline(sink, row);
      end if;
    end loop;
    is_over <= true;
    wait;
  end process;
end test;
